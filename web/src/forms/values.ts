/**
 * Display and input of wire values, with validation. Pure; the server validates again before it sends.
 *
 *     wire 0.7854 ──× scale + bias──▶ shown 45 °        typed "45" ──(− bias) ÷ scale──▶ wire 0.7854
 *
 * A float32 is shown with its seven digits. Integers beyond 2^53 are decimal strings, as on the wire.
 */
import { NONE, number } from "../ui/format/format";
import type { FieldForm } from "../wire/form-types";
import { COMMON } from "../texts/common";
import { TEXT } from "../texts/forms";

export type FormValues = Readonly<Record<string, unknown>>;
/** Path of a value: names of fields (which may contain dots) and indexes in lists. */
export type Path = readonly (string | number)[];

/** The server's form of paths: "outputs.3.output_frequency". */
export const joined = (path: Path): string => path.join(".");

/** The value at a path; undefined if there is none. */
export function at(values: unknown, path: Path): unknown {
  return path.reduce<unknown>(
    (inside, key) => (inside as Record<string | number, unknown> | undefined | null)?.[key],
    values,
  );
}

/** The same values with another one at that path; the rest is shared. */
export function put<T>(values: T, path: Path, value: unknown): T {
  const [key, ...rest] = path;
  if (key === undefined) return value as T;
  const inner = put(at(values, [key]), rest, value);
  if (Array.isArray(values)) return values.map((one, place) => (place === key ? inner : one)) as T;
  return { ...values, [key]: inner };
}

/** Whether two wire values are equal in meaning. */
export function same(a: unknown, b: unknown): boolean {
  if (a === b) return true;
  if (typeof a !== typeof b) return isWhole(a) && isWhole(b) && String(a) === String(b);
  if (typeof a !== "object" || a === null || b === null) return false;
  if (Array.isArray(a) !== Array.isArray(b)) return false;
  const [one, other] = [Object.entries(a), Object.entries(b as object)];
  return one.length === other.length && one.every(([key, value]) => same(value, (b as Record<string, unknown>)[key]));
}

const isWhole = (value: unknown): boolean =>
  Number.isInteger(value) || (typeof value === "string" && /^-?\d+$/.test(value));

/** An integer of any size. */
export function big(value: unknown): bigint {
  if (typeof value === "number" && Number.isFinite(value)) return BigInt(Math.trunc(value));
  return typeof value === "string" && /^-?\d+$/.test(value) ? BigInt(value) : 0n;
}

/** JSON form: a number if JavaScript can represent it, else its digits. */
export function small(value: bigint): number | string {
  const plain = Number(value);
  return Number.isSafeInteger(plain) ? plain : value.toString();
}

const FLOAT32_DIGITS = 7;

/** A real number with its significant digits: seven for a float32, else all. */
function digits(value: number, decimals: number): string {
  if (decimals >= 0) return value.toFixed(decimals);
  return String(Number(value.toPrecision(FLOAT32_DIGITS)));
}

/** Text for an input: plain digits that the same input accepts; an identifier as on its label. */
export function typed(field: FieldForm, wire: unknown): string {
  if (field.base === 16 && wire !== undefined && wire !== null) return identifier(big(wire));
  if (typeof wire === "string") return wire;
  if (typeof wire !== "number" || !Number.isFinite(wire)) return "";
  if (field.step === 1 && field.scale === 1 && field.bias === 0) return String(wire);
  const shown = wire * field.scale + field.bias;
  if (Math.fround(wire) !== wire && field.decimals < 0)
    return String(field.scale === 1 ? shown : Number(shown.toPrecision(15)));
  return digits(shown, Math.abs(shown) < 1e-4 ? -1 : field.decimals);
}

const LONG = 0x8000_0000n;

/** An identifier as on its label: 0080003A, with 64 bits 0080800001. See device_label in protocols/schema/labels.py. */
function identifier(value: bigint): string {
  let [high, low] = [value >> 32n, value & 0xffff_ffffn];
  if ((high & LONG) !== 0n && (low & LONG) === 0n) [high, low] = [low, high];
  const digits = ((high << 32n) | low).toString(16).toUpperCase();
  return digits.padStart((low & LONG) === 0n ? 8 : 10, "0");
}

export type ReadInput = { readonly value: unknown } | { readonly problem: string };

/** The number in a text, or its problem. */
export function read(field: FieldForm, text: string): ReadInput {
  const plain = text
    .trim()
    .replace(/[\u2009\u00a0 ]/g, "")
    .replace("\u2212", "-")
    .replace(",", ".");
  if (plain === "") return { problem: TEXT.numberRequired };
  const whole = field.step === 1 && field.scale === 1 && field.bias === 0;
  if (field.base === 16 && /^[0-9a-f]+$/i.test(plain)) return ranged(field, small(BigInt(`0x${plain}`)));
  if (/^-?0x[0-9a-f]+$/i.test(plain) && whole)
    return ranged(field, small(plain.startsWith("-") ? -BigInt(plain.slice(1)) : BigInt(plain)));
  if (!/^[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?$/i.test(plain)) return { problem: TEXT.notANumber };
  if (whole && /^[-+]?\d+$/.test(plain)) return ranged(field, small(BigInt(plain)));
  if (whole) return { problem: TEXT.wholeNumberRequired };
  const wire = (Number(plain) - field.bias) / field.scale;
  return ranged(field, field.step === 1 ? Math.round(wire) : wire);
}

/** A wire value within the allowed range, or the range in words. */
export function ranged(field: FieldForm, wire: number | string): ReadInput {
  const value = Number(wire);
  const below = field.low !== null && value < field.low - slack(field.low);
  const above = field.high !== null && value > field.high + slack(field.high);
  if (!below && !above && Number.isFinite(value)) return { value: wire };
  return { problem: `${rangeWords(field) || TEXT.numberTooLarge}.` };
}

/** Tolerance of a limit that was converted to another unit and back. */
const slack = (limit: number): number => Math.abs(limit) * 1e-6;

/** The displayed range: "0 to 359.9 °", "at least 1 Hz"; "" without one. */
export function rangeWords(field: FieldForm): string {
  const [low, high] = [field.low, field.high].map((limit) =>
    limit === null ? "" : plainNumber(limit * field.scale + field.bias),
  );
  const unit = field.unit && !field.unit.includes(",") ? ` ${field.unit}` : "";
  if (low && high) return TEXT.numberRange(low, high, unit);
  if (low) return TEXT.atLeast(low, unit);
  return high ? TEXT.atMost(high, unit) : "";
}

/** The range of the setting: a limit that is only its type's says nothing, but where it begins at 0. */
export const ownRangeWords = (field: FieldForm): string =>
  field.limited.length === 0
    ? ""
    : rangeWords({
        ...field,
        low: field.limited.includes("low") || field.low === 0 ? field.low : null,
        high: field.limited.includes("high") ? field.high : null,
      });

function plainNumber(value: number): string {
  const text = String(Number(value.toPrecision(6)));
  return text.includes("e") ? text : number(value, text.split(".")[1]?.length ?? 0);
}

/** A place in a setting in words: "Position, Latitude"; in a list its number, counted from one. */
export function whereOf(form: { readonly title: string; readonly fields: readonly FieldForm[] }, path: string): string {
  const found = [form.title];
  let [fields, rest] = [form.fields, path];
  while (rest !== "") {
    const place = /^(\d+)(?:\.|$)/.exec(rest);
    if (place) {
      found.push(`${found.pop() ?? ""} ${Number(place[1]) + 1}`);
      rest = rest.slice(place[0].length);
      continue;
    }
    const field = fields
      .filter(({ name }) => rest === name || rest.startsWith(`${name}.`))
      .sort((a, b) => b.name.length - a.name.length)[0];
    if (field === undefined) break;
    if (field.title !== form.title) found.push(field.title);
    [fields, rest] = [field.fields, rest.slice(field.name.length + 1)];
  }
  return found.join(", ");
}

/** Initial value of a form's field if neither the device nor the table has one. */
export function initial(field: FieldForm): unknown {
  if (field.default !== null && field.default !== undefined) return field.default;
  switch (field.editor) {
    case "text":
      return "";
    case "hex":
      return "00".repeat(field.length);
    case "record":
      return initials(field.fields);
    case "list":
      return Array.from({ length: field.length }, () => initialElement(field));
    case "vector":
      return Array.from({ length: field.length }, () => initialNumber(field));
    case "choice":
      return Number(Object.keys(field.choices)[0] ?? 0);
    default:
      return initialNumber(field);
  }
}

/** One new element of a list: a record, or a number. */
export function initialElement(field: FieldForm): unknown {
  return field.fields.length > 0 ? initials(field.fields) : initialNumber(field);
}

function initialNumber(field: FieldForm): number {
  return Math.max(field.low ?? 0, Math.min(0, field.high ?? 0));
}

export function initials(fields: readonly FieldForm[]): FormValues {
  return Object.fromEntries(fields.map((field) => [field.name, initial(field)]));
}

/** A wire value in words, with its unit: "400 Hz", "ENU", "A, C"; "—" for none. */
export function valueWords(field: FieldForm, value: unknown): string {
  if (value === undefined || value === null) return NONE;
  if (Array.isArray(value)) {
    if (value.length === 0) return COMMON.none;
    if (field.fields.length > 0) return TEXT.entryCount(value.length);
    const parts = value.slice(0, 4).map((one) => oneWord(field, one));
    return `${parts.join(", ")}${value.length > 4 ? " …" : ""}${field.unit ? ` ${field.unit}` : ""}`;
  }
  if (typeof value === "object") return "…";
  const text = oneWord(field, value);
  const isNamed =
    field.editor === "choice" || field.editor === "flags" || field.editor === "bool" || typeof value === "string";
  return field.unit && !isNamed ? `${text} ${field.unit}` : text;
}

function oneWord(field: FieldForm, value: unknown): string {
  if (field.editor === "bool") return value ? "on" : "off";
  if (Object.keys(field.choices).length > 0) return field.choices[String(value)] ?? String(value);
  if (field.bits.length > 0) return bitWords(field, value);
  if (typeof value === "number" || field.base === 16) return typed(field, value).replace("-", "\u2212");
  return value === "" ? "empty" : String(value);
}

/** Reserved, unused and deprecated values are not offered; one that the device has is shown. */
export const isReserved = ({ name, doc }: { readonly name: string; readonly doc: string }): boolean =>
  /^reserved|(^|_)unused_?\d*$|deprecated$/i.test(name) || /^reserved/i.test(doc);

/** Choices to offer: each meaning once, no reserved or invalid ones, but always the present one. */
export function offered(choices: Readonly<Record<string, string>>, now: unknown): Readonly<Record<string, string>> {
  const all = Object.entries(choices);
  const isNow = (number: string): boolean => now !== undefined && number === String(now);
  const held = all.find(([number]) => isNow(number))?.[1];
  const seen = new Set<string>();
  return Object.fromEntries(
    all.filter(([number, words]) => {
      if (isNow(number)) return true;
      if (words === held || seen.has(words) || /^(invalid|reserved)/i.test(words)) return false;
      seen.add(words);
      return true;
    }),
  );
}

/** The set bits of a word by name. */
export function bitWords(field: FieldForm, value: unknown): string {
  const word = big(value);
  const names = field.bits.flatMap((bits) => {
    const part = bitsOf(word, bits);
    if (bits.width > 1)
      return part === 0n && !("0" in bits.choices) ? [] : [`${bits.name} ${bits.choices[String(part)] ?? part}`];
    return part ? [bits.name] : [];
  });
  return names.join(", ") || "none";
}

interface Place {
  readonly low: number;
  readonly width: number;
}

export function bitsOf(word: bigint, { low, width }: Place): bigint {
  return (word >> BigInt(low)) & ((1n << BigInt(width)) - 1n);
}

/** The same word with other bits at that place. */
export function withBits(word: bigint, { low, width }: Place, part: bigint): bigint {
  const mask = ((1n << BigInt(width)) - 1n) << BigInt(low);
  return (word & ~mask) | ((part << BigInt(low)) & mask);
}

/** Problem of a text or hex field, or undefined. */
export function textProblem(field: FieldForm, text: string): string | undefined {
  if (field.editor === "hex") {
    const plain = text.replace(/\s/g, "");
    if (!/^[0-9a-f]*$/i.test(plain)) return COMMON.hexDigitsOnly;
    if (plain.length % 2 !== 0) return COMMON.twoDigitsPerByte;
    const most = field.length || field.max_length;
    return most > 0 && plain.length / 2 > most ? TEXT.atMostBytes(most) : undefined;
  }
  const most = field.length || field.max_length;
  return most > 0 && text.length > most ? TEXT.atMostCharacters(most) : undefined;
}
