/** Completion of a question in SQL: tables, columns, signals, functions and words of SQL at the caret. */
import type { Completion } from "../../../ui/completion/use-completion";
import type { QueryWords } from "../../../wire/routes";

const MAX_SUGGESTIONS = 8;
const KEYWORDS = (
  "SELECT FROM WHERE GROUP BY ORDER BY LIMIT JOIN LEFT JOIN USING HAVING DISTINCT AS AND OR NOT IN IS NULL BETWEEN LIKE CASE WHEN THEN ELSE END " +
  "DESC ASC UNION ALL WITH OVER PARTITION BY FILTER NULLS LAST CAST INTERVAL DATE TIMESTAMP TRUE FALSE"
).split(" ");
const WORDS = [...new Set(KEYWORDS)];

interface Offer {
  readonly label: string;
  readonly doc: string;
  readonly insert: string;
}

/** What may complete the word before the caret. */
export function completionsOfSql(text: string, caret: number, words: QueryWords | undefined): readonly Completion[] {
  const before = text.slice(0, caret);
  if (/--[^\n]*$/.test(before)) return []; // in a comment
  const inText = /samples\s*\(\s*'([^']*)$/i.exec(before);
  if (inText) return taken(matching(signalsOf(words), inText[1] ?? ""), inText[1] ?? "", caret);
  if (((before.match(/'/g) ?? []).length & 1) === 1) return [];
  const qualified = /([A-Za-z_]\w*)\.(\w*)$/.exec(before);
  if (qualified) {
    const table = tableOf(text, qualified[1] ?? "", words);
    return taken(matching(table?.columns.map(offerOf) ?? [], qualified[2] ?? ""), qualified[2] ?? "", caret);
  }
  const word = /[A-Za-z_]\w*$/.exec(before)?.[0] ?? "";
  const isSource = /\b(from|join)\s+$/i.test(before.slice(0, before.length - word.length));
  if (isSource) return taken(matching(tablesOf(words), word), word, caret);
  if (word === "") return [];
  const offers = [
    ...matching(columnsOf(text, words), word),
    ...matching(functionsOf(words), word).slice(0, 4),
    ...matching(WORDS.map(plain), word).slice(0, 2),
    ...matching(tablesOf(words), word),
  ];
  return taken(offers, word, caret);
}

const plain = (word: string): Offer => ({ label: word, doc: "", insert: word });
const offerOf = ({ name, doc }: { readonly name: string; readonly doc: string }): Offer => ({
  label: name,
  doc,
  insert: /^\w+$/.test(name) ? name : `"${name}"`,
});

function tablesOf(words: QueryWords | undefined): readonly Offer[] {
  return (words?.tables ?? []).map(offerOf);
}

function signalsOf(words: QueryWords | undefined): readonly Offer[] {
  return (words?.signals ?? []).map(({ name, unit }) => ({ label: name, doc: unit, insert: name }));
}

function functionsOf(words: QueryWords | undefined): readonly Offer[] {
  return (words?.functions ?? []).map(({ name, form, doc }) => ({ label: form, doc, insert: `${name}()` }));
}

/** Columns of the tables that a question names; of all tables before it names any. */
function columnsOf(text: string, words: QueryWords | undefined): readonly Offer[] {
  const tables = words?.tables ?? [];
  const named = tables.filter(({ name }) => new RegExp(`\\b${name}\\b`, "i").test(text));
  const seen = new Map<string, Offer>();
  for (const table of named.length > 0 ? named : tables)
    for (const column of table.columns) if (!seen.has(column.name)) seen.set(column.name, offerOf(column));
  return [...seen.values()];
}

/** The table of a name or an alias: `FROM minutes AS m`, `JOIN devices d`. */
function tableOf(text: string, name: string, words: QueryWords | undefined) {
  const alias = new RegExp(`\\b(?:from|join|,)\\s+(\\w+)(?:\\s*\\([^)]*\\))?\\s+(?:as\\s+)?${name}\\b`, "i").exec(text);
  const wanted = (alias?.[1] ?? name).toLowerCase();
  return words?.tables.find((table) => table.name.toLowerCase() === wanted);
}

/** Those that begin with the word, then those that have it elsewhere. */
function matching(offers: readonly Offer[], word: string): readonly Offer[] {
  const search = word.toLowerCase();
  const rank = ({ insert }: Offer): number => insert.toLowerCase().indexOf(search);
  const found = offers.filter((one) => rank(one) >= 0 && one.insert !== word);
  return [...found.filter((one) => rank(one) === 0), ...found.filter((one) => rank(one) > 0)];
}

function taken(offers: readonly Offer[], word: string, caret: number): readonly Completion[] {
  return offers.slice(0, MAX_SUGGESTIONS).map((one) => ({ ...one, from: caret - word.length, to: caret }));
}

/** Offset of a mistake in the text, by the words of the server: "Line 2, column 5: …". */
export function placeOfMistake(message: string, text: string): number | undefined {
  const found = /^Line (\d+), column (\d+): /.exec(message);
  if (!found) return undefined;
  const [line, column] = [Number(found[1]), Number(found[2])];
  const before = text.split("\n").slice(0, line - 1);
  return before.reduce((sum, one) => sum + one.length + 1, 0) + column - 1;
}
