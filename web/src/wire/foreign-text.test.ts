import { readFileSync } from "node:fs";
import { join } from "node:path";
import { expect, test } from "vitest";
import { contained, parseForeign } from "./foreign-text";

const SOURCES = import.meta.glob<string>(["../**/*.{ts,tsx}", "!../**/*.test.*", "!../testing/**"], {
  query: "?raw",
  import: "default",
  eager: true,
});
/** Parsed by JSON.parse itself: what this page wrote, or an address. */
const OWN = [
  "./foreign-text.ts",
  "../extensions/alarms/dialog.tsx",
  "../extensions/alarms/preview.tsx",
  "../extensions/fleet/questions/state.ts",
  "../extensions/viser/scene-frame.tsx",
  "../pages/configure/view-state.ts",
  "../recordings/library-view.ts",
  "../workspace/last-state.ts",
  "../workspace/parts.ts",
];

test.each([
  ["plain", "plain"],
  ["left \u202egnp.exe", "left \u202egnp.exe\u202c"],
  ["\u202aa\u202bb\u202c", "\u202aa\u202bb\u202c\u202c"],
  ["\u2067a\u202eb", "\u2067a\u202eb\u202c\u2069"],
  ["\u2067a\u202eb\u2069c", "\u2067a\u202eb\u2069c"],
  ["\u202c\u2069 closes nothing", "\u202c\u2069 closes nothing"],
])("what turns the direction of %j ends with it", (text, expected) => {
  expect(contained(text)).toBe(expected);
  expect(contained(expected)).toBe(expected); // also when it is stored and comes back
  for (const json of [JSON.stringify({ a: [text] }), `{"a":["${text.replace(/[^ -~]/g, escaped)}"]}`])
    expect(parseForeign(json)).toEqual({ a: [expected] });
});

const escaped = (one: string): string => `\\u${one.charCodeAt(0).toString(16).padStart(4, "0")}`;

/** Regression: U+202E in the name of a device turned the words after it, "Remove" among them. */
test("no text of others comes to the page beside it", () => {
  const parsers = Object.entries(SOURCES).flatMap(([file, source]) => (source.includes("JSON.parse(") ? [file] : []));
  expect(parsers.filter((file) => !OWN.includes(file))).toEqual([]);
});

test("elements are isolated from each other", () => {
  const sheet = readFileSync(join(import.meta.dirname, "../ui/base.css"), "utf8");
  expect(sheet).toMatch(/:where\([^)]*\bspan\b[^)]*\) \{\s*unicode-bidi: isolate;/);
});
