/** Values as they are stored and sent, and guards for those of others. */

/** Most keys in a list, and characters in each: more than any device has. */
const [MAX_KEYS, MAX_KEY] = [2000, 400];

export type Json = null | boolean | number | string | readonly Json[] | JsonObject;

export interface JsonObject {
  readonly [key: string]: Json;
}

export function isObject(json: unknown): json is JsonObject {
  return typeof json === "object" && json !== null && !Array.isArray(json);
}

/** A finite number within its limits. */
export function isNumber(json: Json | undefined, least = -Infinity, greatest = Infinity): json is number {
  return typeof json === "number" && Number.isFinite(json) && json >= least && json <= greatest;
}

/** A list of different keys. */
export function isKeys(json: Json | undefined): json is readonly string[] {
  return (
    Array.isArray(json) &&
    json.length <= MAX_KEYS &&
    json.every((key) => typeof key === "string" && key.length > 0 && key.length <= MAX_KEY) &&
    new Set(json).size === json.length
  );
}
