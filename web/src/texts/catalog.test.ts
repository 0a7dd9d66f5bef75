/** The catalogue holds every text of the page, in plain English, with plurals by one function. */
import { describe, expect, it } from "vitest";
import { parseSync } from "vite";

type Node = { readonly type: string; readonly [key: string]: unknown };

const SOURCES = import.meta.glob<string>(
  [
    "../**/*.{ts,tsx}",
    "!../**/*.test.*",
    "!../**/*.d.ts",
    "!../testing/**",
    "!./*",
    "!../extensions/**/{texts,*-texts}.ts",
    "!../wire/{*types,routes,texts}.ts",
  ],
  { query: "?raw", import: "default", eager: true },
);
const CATALOG = import.meta.glob<Record<string, unknown>>(
  ["./*.ts", "../wire/texts.ts", "../extensions/**/{texts,*-texts}.ts", "!./plural.ts", "!./*.test.ts"],
  { eager: true },
);

/** Files with literals that resemble texts: benchmark, drawings, names used by devices and search. */
const EXEMPT =
  /plots\/(bench|synthetic)\.ts|ui\/(controls\/icons|format\/labels)\.tsx?|forms\/search\.ts|signals\/quantities\.ts|fixtures\.ts|panels\/value-groups\.ts/;
/** Units and names that are the same in every language. */
const UNIT =
  /^[\s·().,:%/×▲●○△+−\d-]*(Hz|Bd|B|B\/s|s|ms|S\/N|0x|dB-Hz|σ|imuscope|CSV|Parquet|MCAP|RRD|MTB|RAW)?[\s·().,:%/×-]*$/;
/** Attributes and properties whose literal is displayed or read aloud. */
const READ = /^(title|aria-label|ariaLabel|placeholder|label|alt|words|message|hint|help)$/;
const SENTENCE = /^[A-Z][a-z]+ .*[a-z]{2}|[a-z]{2} [a-z]{2,}.*[.…!?]$/;

const isNode = (value: unknown): value is Node => typeof value === "object" && value !== null && "type" in value;
const literal = (node: unknown): string | undefined =>
  isNode(node) && node.type === "Literal" && typeof node["value"] === "string" ? node["value"] : undefined;
const nameOf = (node: unknown): string =>
  isNode(node)
    ? String(node["name"] ?? node["value"] ?? (isNode(node["property"]) ? nameOf(node["property"]) : ""))
    : "";
const isWords = (text: string | undefined): boolean =>
  text !== undefined && /\p{L}/u.test(text) && !UNIT.test(text.trim());

/** Literals that an expression shows: itself, or a branch of it. */
function shown(node: unknown): readonly string[] {
  if (!isNode(node)) return [];
  if (node.type === "JSXExpressionContainer") return shown(node["expression"]);
  if (node.type === "ConditionalExpression") return [...shown(node["consequent"]), ...shown(node["alternate"])];
  if (node.type === "LogicalExpression") return shown(node["right"]);
  const text = literal(node);
  return text !== undefined && isWords(text) ? [text] : [];
}

/** Texts in a source file itself, and hand-made plurals. */
function strayTexts(file: string, source: string): readonly string[] {
  const found: string[] = [];
  const visit = (node: Node, parent: Node | undefined): void => {
    if (/^(TS(Type|Interface|Literal|Union)|Import|ExportAll)/.test(node.type)) return;
    if (node.type === "NewExpression" && nameOf(node["callee"]) === "Error") return; // for the console
    if (node.type === "JSXText" && isWords(String(node["value"]))) found.push(String(node["value"]).trim());
    else if (node.type === "JSXAttribute" && READ.test(nameOf(node["name"]))) found.push(...shown(node["value"]));
    else if (node.type === "JSXExpressionContainer" && parent?.type !== "JSXAttribute") found.push(...shown(node));
    else if (node.type === "Property" && READ.test(nameOf(node["key"]))) found.push(...shown(node["value"]));
    else if (node.type === "CallExpression" && nameOf(node["callee"]) === "el")
      found.push(...(node["arguments"] as readonly Node[]).slice(2).flatMap(shown));
    else if (node.type === "Literal" && SENTENCE.test(literal(node) ?? "")) found.push(literal(node) ?? "");
    else if (node.type === "TemplateLiteral") {
      const parts = (node["quasis"] as readonly { readonly value: { readonly cooked: string } }[]).map(
        ({ value }) => value.cooked,
      );
      if (SENTENCE.test(parts.join("x"))) found.push(parts.join("…"));
    } else if (
      node.type === "ConditionalExpression" &&
      isNode(node["test"]) &&
      isNode(node["test"]["right"]) &&
      node["test"]["right"]["value"] === 1 &&
      literal(node["consequent"]) !== undefined &&
      /s$/.test(literal(node["alternate"]) ?? "")
    )
      found.push(`plural by hand: ${literal(node["alternate"])}`);
    for (const [key, value] of Object.entries(node))
      if (key !== "type")
        for (const child of Array.isArray(value) ? value : [value]) if (isNode(child)) visit(child, node);
  };
  visit(parseSync(file, source).program as unknown as Node, undefined);
  return [...new Set(found)];
}

/** Every text of the catalogue with its key; functions are called with 1. */
function texts(value: unknown, key: string): readonly (readonly [key: string, text: string])[] {
  if (typeof value === "function") {
    const fill = value as (...values: readonly number[]) => unknown;
    return texts(fill(...Array.from({ length: value.length }, () => 1)), key);
  }
  if (typeof value === "string") return [[key, value]];
  return Object.entries(value as object).flatMap(([name, one]) => texts(one, `${key}.${name}`));
}

/** Words and phrases that a technical writer avoids. */
const AVOIDED =
  /\b(anew|aside|beside each other|by itself|heard|hears|kept|likewise|meanwhile|nobody|somebody|thereby|told|tells|wherever|whoever|what (came|is read|was)|(is|has) none|any more|try number)\b/i;
const ALL = Object.entries(CATALOG).flatMap(([file, module]) => texts(module, file));

/** Sources that import a file of the catalogue. */
function sourcesOf(file: string): readonly string[] {
  const place = (name: string, from: string): string => new URL(name, new URL(from, "file:///src/texts/")).pathname;
  const wanted = place(file, "").replace(/\.ts$/, "");
  return Object.entries(SOURCES).flatMap(([path, source]) =>
    [...source.matchAll(/from\s"(\.[^"]*texts[^"]*)"/g)].some(([, name = ""]) => place(name, path) === wanted)
      ? [source]
      : [],
  );
}

const listed = (wrong: readonly (readonly [string, string])[]): readonly string[] =>
  wrong.map(([key, text]) => `${key}: ${text}`);

describe("the catalogue", () => {
  it("holds all texts of the sources", () => {
    expect(Object.keys(SOURCES).length).toBeGreaterThan(150);
    const stray = Object.entries(SOURCES)
      .filter(([file]) => !EXEMPT.test(file))
      .flatMap(([file, source]) => strayTexts(file, source).map((text) => `${file}: ${text}`));
    expect(stray).toEqual([]);
  });

  it("has no avoided words, and no space before an ellipsis", () => {
    expect(ALL.length).toBeGreaterThan(800);
    expect(listed(ALL.filter(([, text]) => AVOIDED.test(text) || / …$/.test(text)))).toEqual([]);
  });

  it("asks only where a dialog waits for the answer, and opens with no question word", () => {
    const asks = ALL.filter(([key, text]) => text.includes("?") && !/\.confirm\w*$/.test(key));
    const opens = ALL.filter(([, text]) => /^(What|How|Which|Who|Whose|Why|Where)\b/.test(text));
    const wanted = [...asks, ...opens].filter(([key]) => !key.endsWith(".whatIsThis")); // asked by who looks
    expect(listed(wanted.filter(([, text]) => !/\(\?\)$|:\/\//.test(text)))).toEqual([]);
  });

  it("has the singular for one", () => {
    expect(
      listed(
        ALL.filter(([, text]) => /(^|\s)1 (more )?(?!times|samples\/s|sends|bytes in)[a-z]{3,}[^s\W]s\b/.test(text)),
      ).filter((one) => !one.startsWith("../wire/texts.ts")),
    ).toEqual([]);
  });

  it("has no entry that nothing shows", () => {
    const unused = Object.entries(CATALOG).flatMap(([file, { COMMON, TEXT }]) => {
      const users = sourcesOf(file).join("\n");
      return Object.keys((COMMON ?? TEXT) as object)
        .filter((key) => !new RegExp(`\\.${key}\\b`).test(users))
        .map((key) => `${file}: ${key}`);
    });
    expect(unused).toEqual([]);
  });

  it("finds a text in a source file", () => {
    expect(strayTexts("a.tsx", "<p title='Go'>Stop {n} <b>{ok ? 'yes' : n}</b></p>")).toEqual(["Go", "Stop", "yes"]);
    expect(strayTexts("a.ts", "const a = { hint: 'Wait' }; f('Try it again.'); b('Take ' + n)")).toHaveLength(2);
    expect(strayTexts("a.ts", "const s = n === 1 ? 'frame' : 'frames';")).toEqual(["plural by hand: frames"]);
    expect(strayTexts("a.tsx", "<p class='btn main'>{TEXT.stop} 5 Hz</p>")).toEqual([]);
  });
});
