/** Style precedence is given by layers in one file, independent of load order; every styled class is used. */
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { describe, expect, it } from "vitest";

const read = (file: string): string => new TextDecoder().decode(readFileSync(join(import.meta.dirname, file)));
/** A style sheet without comments and imports. */
const bare = (file: string): string =>
  read(file)
    .replaceAll(/\/\*.*?\*\/|@import [^;]+;/gs, "")
    .trim();

const ORDER = "./layers.css";
const FILES = Object.keys(import.meta.glob("../**/*.css")).filter((file) => !file.endsWith("/layers.css"));
const declared = bare(ORDER).slice("@layer ".length, -1).split(/,\s*/);

/** Name of the extension that a file belongs to. */
const extensionOf = (file: string): string | undefined => /\/extensions\/([\w-]+)\//.exec(file)?.[1];

/** The layer with all rules of a file; undefined if a rule is outside a layer or in a second one. */
function layerOf(file: string): string | undefined {
  const [, name, rules = ""] = /^@layer ([\w.-]+) \{(.*)\}$/s.exec(bare(file)) ?? [];
  let depth = 0;
  for (const [brace] of rules.matchAll(/[{}]/g)) if ((depth += brace === "{" ? 1 : -1) < 0) return undefined;
  return name;
}

describe("layers of style", () => {
  it("are declared in one statement, none twice", () => {
    expect(bare(ORDER)).toMatch(/^@layer [^;{}]+;$/);
    expect(new Set(declared).size).toBe(declared.length);
  });

  it("hold every rule of the page: one layer for each file", () => {
    expect(FILES.filter((file) => layerOf(file) === undefined)).toEqual([]);
    expect(
      FILES.filter((file) => !extensionOf(file))
        .map(layerOf)
        .sort(),
    ).toEqual(declared.filter((name) => name !== "extensions").toSorted());
  });

  it("of an extension are within its own", () => {
    const foreign = FILES.filter((file) => {
      const name = extensionOf(file);
      return name !== undefined && !`${layerOf(file)}.`.startsWith(`extensions.${name}.`);
    });
    expect(foreign).toEqual([]);
    expect(declared).toContain("extensions");
  });

  it("of an extension with several are in the order of its layers.css", () => {
    for (const name of new Set(FILES.flatMap((file) => extensionOf(file) ?? []))) {
      const sheets = FILES.filter((file) => extensionOf(file) === name);
      if (sheets.length === 1) continue;
      const order = bare(`../extensions/${name}/layers.css`).slice("@layer ".length, -1).split(/,\s*/);
      expect(sheets.map(layerOf).sort()).toEqual(order.toSorted());
    }
  });

  it.each(["index.html", "bench.html"])("are known before any style sheet of %s", (page) => {
    const html = read(`../../${page}`);
    const first = html.indexOf('<link rel="stylesheet"');
    expect(html.slice(first)).toMatch(/^<link rel="stylesheet" href="\/src\/ui\/layers.css"/);
    expect(first).toBeLessThan(html.indexOf('type="module"'));
  });

  it("are known before any style sheet of docs.html", () => {
    expect(read("../docs/docs.css").match(/@\w+ [^;{]+/)?.[0]).toBe('@import "../ui/layers.css"');
  });
});

/** Folders whose elements are shown only together with those of another folder, whose sheets are there by then. */
const GUESTS: Readonly<Record<string, readonly string[]>> = {
  "../charts": ["analysis", "fleet/questions", "histogram", "xy"].map((name) => `../extensions/${name}`),
  "../extensions/workspaces": ["../extensions/alarms"],
  "../forms": ["../pages/configure", "../extensions/rollouts", "../extensions/traffic"],
  "../pages/configure": ["../forms", "../extensions/corrections", "../extensions/rollouts"],
  "../plots": [".."], // of the first load
};

describe("classes", () => {
  const code = Object.keys(
    import.meta.glob([
      "../**/*.{ts,tsx}",
      "!../**/*.test.*",
      "!../texts/*",
      "!../wire/texts.ts",
      "!../extensions/**/{texts,*-texts}.ts",
    ]),
  );
  const words = new Set(
    code.flatMap((file) => read(file).match(/"[^"\n]*"|`[^`]*`/g) ?? []).flatMap((text) => text.match(/[\w-]+/g) ?? []),
  );

  it.each(FILES.filter((file) => !file.includes("docs.css")))("of %s are given to an element somewhere", (file) => {
    const selectors = [...bare(file).matchAll(/([^{};]+)\{/g)].map(([, selector = ""]) => selector);
    const named = selectors
      .filter((one) => !one.trim().startsWith("@"))
      .flatMap((one) => one.match(/(?<=\.)[A-Za-z][\w-]*/g) ?? []);
    expect(named.filter((name) => !words.has(name))).toEqual([]);
  });

  it("belong to one folder each: a page that is opened later changes nothing on another", () => {
    const owners = new Map<string, Set<string>>();
    for (const file of FILES.filter((one) => !/^\.\/|\/(evidence|docs)\/|phone\.css$/.test(one))) {
      const folder = file.slice(0, file.lastIndexOf("/"));
      // rules of a class alone; sheets of a phone and of other documents stand for themselves
      for (const [, name = ""] of bare(file)
        .replaceAll(/\([^()]*\)/g, "")
        .matchAll(/(?<=[{},;]\s*)\.([\w-]+)(?=\s*[,{])/g))
        owners.set(name, (owners.get(name) ?? new Set()).add(folder));
    }
    expect(owners.size).toBeGreaterThan(2 * FILES.length);
    expect([...owners].filter(([, folders]) => folders.size > 1)).toEqual([]);
    const foreign = code.flatMap((file) =>
      [...read(file).matchAll(/(?:class|look)(?:=|: )\{?["`]([^"`]*)/g)]
        .flatMap(([, names = ""]) => names.split(" "))
        .flatMap((name) => [...(owners.get(name) ?? [])].map((owner) => ({ file, name, owner })))
        .filter(({ owner }) => ![owner, ...(GUESTS[owner] ?? [])].some((folder) => file.startsWith(`${folder}/`))),
    );
    expect(foreign).toEqual([]);
  });
});
