// SPDX-License-Identifier: Apache-2.0
// What the bridge tells of the record. The token goes in a header, never in an address.

export class Desk {
  constructor(token) {
    this.headers = { Authorization: `Bearer ${token}` };
  }

  // Returns the answer; given: what is written, none to read. Throws an Error with a sentence.
  async ask(path, given = null) {
    const how = given ? { method: "POST", body: JSON.stringify(given) } : {};
    let answer;
    try {
      answer = await fetch(`/record/${path}`, { ...how, headers: this.headers });
    } catch {
      throw new Error("", { cause: "silent" });
    }
    if (!answer.ok) throw new Error((await answer.text()).trim());
    return answer;
  }

  async json(path, given) {
    return (await this.ask(path, given)).json();
  }

  // Lets the browser save a file.
  async save(path) {
    const answer = await this.ask(path);
    const [, name] = answer.headers.get("Content-Disposition").match(/filename="(.*)"/);
    const address = URL.createObjectURL(await answer.blob());
    const link = document.createElement("a");
    [link.href, link.download] = [address, name];
    link.click();
    setTimeout(() => URL.revokeObjectURL(address), 10000);
  }
}
