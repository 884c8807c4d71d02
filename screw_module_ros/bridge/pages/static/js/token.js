// SPDX-License-Identifier: Apache-2.0
// The token comes behind the # of the address, which a browser sends to nobody. It is kept for
// this tab, so that a reload works, and taken out of the address bar, where others could read it.

export function ownToken() {
  const given = new URLSearchParams(location.hash.slice(1)).get("token");
  if (given) {
    sessionStorage.setItem("token", given);
    history.replaceState(null, "", location.pathname + location.search);
  }
  return sessionStorage.getItem("token") ?? "";
}
