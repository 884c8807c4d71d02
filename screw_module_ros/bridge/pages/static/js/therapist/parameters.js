// SPDX-License-Identifier: Apache-2.0
// Parameters of the session's node that the cards set.

export const FORCE = "support.force";
const BOOL = 1, DOUBLE = 3; // ParameterType.msg

// Sets one; value: a number, or true or false. Throws an error with the node's reason where it refuses.
export async function setParameter(call, name, value) {
  const typed = typeof value === "boolean" ? { type: BOOL, bool_value: value } : { type: DOUBLE, double_value: value };
  const parameters = [{ name, value: typed }];
  const { results: [{ successful, reason }] } = await call("therapy_session/set_parameters", { parameters });
  if (!successful) throw new Error(reason);
}
