/** Pages of the guide, as they are in docs/guide when the page is built, and their search. */
import { blocksOf, slugOf } from "./markdown";

interface GuidePage {
  readonly name: string;
  readonly title: string;
  readonly text: string;
}

export interface GuidePlace {
  readonly page: string;
  /** Heading of the section, and its identifier; "" for the page itself. */
  readonly heading: string;
  readonly slug: string;
}

const FILES = import.meta.glob<string>("../../../docs/guide/*.md", { query: "?raw", import: "default", eager: true });

/** First steps first, the others by title. */
export const PAGES: readonly GuidePage[] = Object.entries(FILES)
  .map(([path, text]) => ({
    name: path.replace(/^.*\/|\.md$/g, ""),
    title: /^# (.*)/.exec(text)?.[1] ?? path,
    text,
  }))
  .sort((a, b) => Number(b.name === "first-look") - Number(a.name === "first-look") || a.title.localeCompare(b.title));

export const pageOf = (name: string): GuidePage | undefined => PAGES.find((page) => page.name === name);

const MAX_FOUND = 30;

interface Section extends GuidePlace {
  readonly title: string;
  readonly text: string;
}

function sectionsOf({ name, title, text }: GuidePage): readonly Section[] {
  const sections: Section[] = [];
  for (const lines of blocksOf(text)) {
    const [, level, words = ""] = /^(#+) (.*)/.exec(lines[0] ?? "") ?? [];
    const own = level === "#" ? "" : words;
    if (level)
      sections.push({
        page: name,
        heading: own,
        slug: own && slugOf(own),
        title: `${title} ${words}`.toLowerCase(),
        text: "",
      });
    const last = sections.pop();
    if (last) sections.push({ ...last, text: `${last.text}\n${lines.join(" ").toLowerCase()}` });
  }
  return sections;
}

const SECTIONS = PAGES.flatMap(sectionsOf);

/** Sections that have every word, those with words in their heading first. */
export function searchGuide(query: string): readonly GuidePlace[] {
  const words = query.toLowerCase().split(/\s+/).filter(Boolean);
  return SECTIONS.filter(({ title, text }) => words.every((word) => title.includes(word) || text.includes(word)))
    .map((section) => ({ section, named: words.filter((word) => section.title.includes(word)).length }))
    .sort((a, b) => b.named - a.named)
    .slice(0, MAX_FOUND)
    .map(({ section: { page, heading, slug } }) => ({ page, heading, slug }));
}
