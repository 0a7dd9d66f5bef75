/** Search of settings and commands by a few letters. Pure; names rank before titles, titles before descriptions. */
import type { FieldForm, Forms, RateTable } from "../wire/form-types";

interface Found {
  readonly kind: "setting" | "command";
  readonly name: string;
  readonly title: string;
  readonly group: string;
  /** The matching field or table entry: "ser0BaudRate", "Quaternion"; "" for the form. */
  readonly field: string;
  /** Its place in the form: the name of a field, the number of a data set or quantity; "" for the form itself. */
  readonly at: string;
}

interface Entry extends Found {
  readonly isDeprecated: boolean;
  readonly texts: readonly (readonly [weight: number, text: string, field: string, at: string])[];
}

export type Index = readonly Entry[];

const MAX_FOUND = 60;

/** The search index, built once for the forms of a device. */
export function indexOf(forms: Forms): Index {
  const entry = (
    kind: Found["kind"],
    row: { name: string; title: string; group: string; doc: string },
    fields: readonly FieldForm[],
  ): Entry => ({
    kind,
    name: row.name,
    title: row.title,
    group: row.group,
    field: "",
    at: "",
    isDeprecated: /\bdeprecated\b/i.test(row.doc),
    texts: [
      [8, fold(row.title), "", ""],
      [7, fold(row.name), "", ""],
      [3, fold(row.group), "", ""],
      [2, fold(row.doc), "", ""],
      ...fields.flatMap((field) => fieldTexts(field)),
    ],
  });
  return [
    ...forms.settings.map((row) => {
      const own = entry("setting", row, row.fields);
      return { ...own, texts: [...own.texts, ...tableTexts(row.table)] };
    }),
    ...forms.commands.map((row) => entry("command", row, row.arguments)),
  ];
}

/** Rows of a table, by name and by number: "Quaternion", "0x2010". */
function tableTexts(table: RateTable | null): Entry["texts"] {
  return (table?.rows ?? []).flatMap(({ id, name, title, doc }) => {
    const hex = `0x${id.toString(16).padStart(4, "0")}`;
    const place = table?.key_digits ? hex : String(id);
    return [
      [5, fold([title, name, ...new Set([place, hex])].filter(Boolean).join(" ")), title, place],
      [2, fold(doc), title, place],
    ] as const;
  });
}

/** Texts of a field, located at its outermost field, to which a form can scroll. */
function fieldTexts(field: FieldForm, at = field.name): Entry["texts"] {
  const words = [
    ...Object.values(field.choices),
    ...field.bits.flatMap(({ name, doc, choices }) => [name, doc, ...Object.values(choices)]),
  ].join(" ");
  const own: Entry["texts"] = [
    [5, fold(`${field.title} ${field.name}`), field.title, at],
    [2, fold(field.doc), field.title, at],
    [2, fold(words), field.title, at],
  ];
  return [...own, ...field.fields.flatMap((inner) => fieldTexts(inner, at))];
}

/** Common words and the documents' words for the same thing; each finds the other. */
const MEANT: readonly (readonly [said: string, written: readonly string[]])[] = [
  [
    "lever arm",
    [
      "lever arm",
      "gnss lever",
      "antenna offset",
      "ant offset",
      "antenna, place",
      "antenna",
      "insoffset",
      "output point",
    ],
  ],
  ["mounting", ["alignment", "insrotation", "sensor rotation", "mounting"]],
  ["sampling rate", ["output configuration", "nav dt", "imu dt", "period"]],
  ["bias", ["bias", "no-rotation", "no rotation"]],
  ["serial port", ["port", "ser0", "ser1", "ser2", "uart"]],
  ["compass", ["magnet", "heading"]],
];

/** Texts that match a query: itself, or the documents' word for it. */
export function meanings(query: string): readonly string[] {
  const wanted = fold(query).trim();
  const found = MEANT.filter(([said]) => wanted.includes(said)).flatMap(([, written]) => written);
  return [query, ...found];
}

/** Letters for comparison: without case and accents, names split into words. */
function fold(text: string): string {
  const spread = text.replace(/([a-z])([A-Z0-9])/g, "$1 $2").replace(/[_.]+/g, " ");
  return `${text} ${spread}`
    .normalize("NFKD")
    .replace(/\p{M}/gu, "")
    .replace(/(\d)[\s\u2009](?=\d{3}\b)/gu, "$1")
    .toLowerCase();
}

/** Results, best first, in three parts: settings that match by a name, others, deprecated ones. Every word must match, directly or by the documents' word. */
export function search(index: Index, query: string): readonly Found[] {
  const [own = "", ...others] = meanings(query);
  const found = new Map<string, readonly [Found, number]>();
  [own, ...others].forEach((one, place) => {
    for (const [entry, score] of scored(index, one)) {
      const key = `${entry.kind} ${entry.name}`;
      const weighed = score - (place > 0 ? OTHER_WORDS : 0);
      if ((found.get(key)?.[1] ?? -Infinity) < weighed) found.set(key, [entry, weighed]);
    }
  });
  return [...found.values()]
    .sort((a, b) => b[1] - a[1])
    .slice(0, MAX_FOUND)
    .map(([one]) => one);
}

/** Penalty of a match by other words than those typed. */
const OTHER_WORDS = 4;
/** Of a match in a description, and less than that of a name. */
const DESCRIPTION = 2;
/** More than any score. */
const PART = 1000;

function scored(index: Index, query: string): readonly (readonly [Found, number])[] {
  const words = [...new Set(query.trim() === "" ? [] : typedWords(query))];
  if (words.length === 0) return [];
  return index.flatMap((entry) => {
    const hits = words.map((word) => best(entry, word));
    if (hits.some((hit) => hit === undefined)) return [];
    const isNamed = hits.every((hit) => (hit?.weight ?? 0) > DESCRIPTION);
    const part = entry.isDeprecated ? -PART : entry.kind === "setting" && isNamed ? PART : 0;
    const score = hits.reduce((sum, hit) => sum + (hit?.score ?? 0), part);
    const { kind, name, title, group } = entry;
    const inside = hits.find((hit) => hit?.field);
    return [[{ kind, name, title, group, field: inside?.field ?? "", at: inside?.at ?? "" }, score] as const];
  });
}

/** An identifier is one word: "0x2010" is not taken apart. */
function typedWords(query: string): readonly string[] {
  return query
    .split(/\s+/)
    .filter(Boolean)
    .flatMap((word) => (/^0x[0-9a-f]+$/i.test(word) ? [word.toLowerCase()] : fold(word).trim().split(/\s+/)));
}

interface Hit {
  readonly weight: number;
  readonly score: number;
  readonly field: string;
  readonly at: string;
}

function best({ texts }: Entry, word: string): Hit | undefined {
  let found: Hit | undefined;
  for (const [weight, text, field, at] of texts) {
    const place = text.indexOf(word);
    if (place < 0) continue;
    const begins = place === 0 || text[place - 1] === " ";
    const score = weight + (begins ? 3 : 0);
    if (found === undefined || score > found.score) found = { weight, score, field, at };
  }
  return found;
}
