/** Which settings and commands does a person mean by a few letters? Pure; names before titles before what is written about them. */
import type { FieldForm, Forms } from "./types";

export interface Found {
  readonly kind: "setting" | "command";
  readonly name: string;
  readonly title: string;
  readonly group: string;
  /** What matched, where that was a field: "ser0BaudRate". */
  readonly field: string;
}

interface Entry extends Found {
  readonly texts: readonly (readonly [weight: number, text: string, field: string])[];
}

export type Index = readonly Entry[];

const MOST_FOUND = 60;

/** Everything that can be searched, once for the forms of a device. */
export function indexOf(forms: Forms): Index {
  const entry = (kind: Found["kind"], row: { name: string; title: string; group: string; doc: string }, fields: readonly FieldForm[]): Entry => ({
    kind, name: row.name, title: row.title, group: row.group, field: "",
    texts: [[8, fold(row.title), ""], [7, fold(row.name), ""], [3, fold(row.group), ""], [2, fold(row.doc), ""], ...fields.flatMap(fieldTexts)],
  });
  return [
    ...forms.settings.map((row) => entry("setting", row, row.fields)),
    ...forms.commands.map((row) => entry("command", row, row.arguments)),
  ];
}

function fieldTexts(field: FieldForm): Entry["texts"] {
  const words = [...Object.values(field.choices), ...field.bits.flatMap(({ name, doc, choices }) => [name, doc, ...Object.values(choices)])].join(" ");
  const own: Entry["texts"] = [[5, fold(`${field.title} ${field.name}`), field.title], [2, fold(field.doc), field.title], [2, fold(words), field.title]];
  return [...own, ...field.fields.flatMap(fieldTexts)];
}

/** Letters as they are typed: no case, no accents, names by their words. */
function fold(text: string): string {
  const spread = text.replace(/([a-z])([A-Z0-9])/g, "$1 $2").replace(/[_.]+/g, " ");
  return `${text} ${spread}`.normalize("NFKD").replace(/\p{M}/gu, "").replace(/(\d)[\s\u2009](?=\d{3}\b)/gu, "$1").toLowerCase();
}

/** The best first. Every word must be there; a setting is worth more than the command that writes it. */
export function search(index: Index, query: string): readonly Found[] {
  const wanted = fold(query).split(/\s+/).filter(Boolean);
  const words = [...new Set(query.trim() === "" ? [] : wanted)];
  if (words.length === 0) return [];
  const scored = index.flatMap((entry) => {
    const hits = words.map((word) => best(entry, word));
    if (hits.some((hit) => hit === undefined)) return [];
    const score = hits.reduce((sum, hit) => sum + (hit?.score ?? 0), 0) + (entry.kind === "setting" ? 4 : 0);
    const { kind, name, title, group } = entry;
    return [{ found: { kind, name, title, group, field: hits.find((hit) => hit?.field)?.field ?? "" }, score }];
  });
  return scored.sort((a, b) => b.score - a.score).slice(0, MOST_FOUND).map(({ found }) => found);
}

function best({ texts }: Entry, word: string): { readonly score: number; readonly field: string } | undefined {
  let found: { score: number; field: string } | undefined;
  for (const [weight, text, field] of texts) {
    const place = text.indexOf(word);
    if (place < 0) continue;
    const begins = place === 0 || text[place - 1] === " ";
    const score = weight + (begins ? 3 : 0);
    if (found === undefined || score > found.score) found = { score, field };
  }
  return found;
}
