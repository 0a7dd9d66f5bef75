/**
 * The Markdown of the guide as elements: headings, paragraphs, lists, tables, code, links, bold, emphasis.
 *
 * Only what docs/guide uses, so no HTML is taken from the text; guide.test.tsx fails on a page that has more. Pictures are left out:
 * the page itself is there.
 */
import type { ComponentChild, VNode } from "preact";

/** Identifier of a heading, as in its links: "Moving through time" → "moving-through-time". */
export const slugOf = (heading: string): string =>
  heading
    .toLowerCase()
    .replace(/[^\p{L}\p{N}\s_-]/gu, "")
    .trim()
    .replace(/\s+/g, "-");

interface Links {
  /** Element of a link to that address. */
  readonly link: (href: string, words: ComponentChild) => VNode;
}

const INLINE = /(`+)(.+?)\1|\*\*(.+?)\*\*|\*(\S.*?)\*|\[((?:[^[\]]|\[[^\]]*\])+)\]\(([^)\s]+)\)/;

/** Words of a line. */
function inline(text: string, links: Links): ComponentChild[] {
  const found = INLINE.exec(text);
  if (!found) return [text.replace(/\\([\\`*_|[\]])/g, "$1")];
  const [all, , code, bold, em, words, href] = found;
  const middle =
    code !== undefined ? (
      <code>{code.trim().replaceAll("\\|", "|")}</code>
    ) : bold !== undefined ? (
      <b>{inline(bold, links)}</b>
    ) : em !== undefined ? (
      <em>{inline(em, links)}</em>
    ) : (
      links.link(href ?? "", inline(words ?? "", links))
    );
  return [
    ...inline(text.slice(0, found.index), links),
    middle,
    ...inline(text.slice(found.index + all.length), links),
  ].filter((part) => part !== "");
}

const isTable = (lines: readonly string[]): boolean => /^\|[\s:|-]+\|$/.test(lines[1] ?? "");
const cellsOf = (line: string): readonly string[] =>
  line
    .replace(/^\||\|\s*$/g, "")
    .split(/(?<!\\)\|/)
    .map((cell) => cell.trim());

function table([head = "", , ...rows]: readonly string[], links: Links): VNode {
  return (
    <table>
      <thead>
        <tr>
          {cellsOf(head).map((cell, i) => (
            <th key={i}>{inline(cell, links)}</th>
          ))}
        </tr>
      </thead>
      <tbody>
        {rows.map((row, k) => (
          <tr key={k}>
            {cellsOf(row).map((cell, i) => (
              <td key={i}>{inline(cell, links)}</td>
            ))}
          </tr>
        ))}
      </tbody>
    </table>
  );
}

const ITEM = /^(\s*)(?:[-*]|(\d+)\.)\s+/;

/** A list; deeper items are in a list of their own. */
function list(lines: readonly string[], links: Links): VNode {
  const first = ITEM.exec(lines[0] ?? "");
  const depth = first?.[1]?.length ?? 0;
  const items: { words: string; inner: string[] }[] = [];
  for (const line of lines) {
    const found = ITEM.exec(line);
    const last = items.at(-1);
    if (found && (found[1]?.length ?? 0) <= depth) items.push({ words: line.slice(found[0].length), inner: [] });
    else if (last && (found || last.inner.length > 0)) last.inner.push(line);
    else if (last) last.words += ` ${line.trim()}`;
  }
  const drawn = items.map(({ words, inner }, i) => (
    <li key={i}>
      {inline(words, links)}
      {inner.length > 0 && list(inner, links)}
    </li>
  ));
  return first?.[2] === undefined ? <ul>{drawn}</ul> : <ol>{drawn}</ol>;
}

/** Blocks of a text: its lines between empty ones; those of code stay together. */
export function blocksOf(text: string): readonly (readonly string[])[] {
  const blocks: string[][] = [[]];
  let isCode = false;
  for (const line of text.split("\n")) {
    const fence = line.startsWith("```");
    if ((fence && !isCode) || (!isCode && (line.trim() === "" || line.startsWith("#")))) blocks.push([]);
    if (isCode || line.trim() !== "") blocks.at(-1)?.push(line);
    if ((fence && isCode) || (!isCode && line.startsWith("#"))) blocks.push([]);
    if (fence) isCode = !isCode;
  }
  return blocks.filter(([first]) => first !== undefined && !first.startsWith("!["));
}

/** The elements of a text. */
export function markdown(text: string, links: Links): VNode[] {
  return blocksOf(text).map((lines, i) => {
    const [first = ""] = lines;
    const heading = /^(#+)\s+(.*)/.exec(first);
    if (heading) {
      const words = heading[2] ?? "";
      const Level = heading[1] === "###" ? "h4" : "h3";
      return (
        <Level key={i} id={`guide-${slugOf(words)}`}>
          {inline(words, links)}
        </Level>
      );
    }
    if (first.startsWith("```"))
      return (
        <pre key={i} tabIndex={0}>
          <code>{lines.slice(1, -1).join("\n")}</code>
        </pre>
      );
    if (isTable(lines)) return table(lines, links);
    if (ITEM.test(first)) return list(lines, links);
    return <p key={i}>{inline(lines.join(" "), links)}</p>;
  });
}
