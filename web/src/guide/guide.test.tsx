// @vitest-environment happy-dom
import { fireEvent, render, screen, waitFor } from "@testing-library/preact";
import type { VNode } from "preact";
import { expect, it, test } from "vitest";
import { find } from "../testing/queries";
import { Guide } from "./guide";
import { blocksOf, markdown, slugOf } from "./markdown";
import { PAGES, pageOf, searchGuide } from "./pages";

const drawn = (text: string, hrefs: string[] = []): HTMLElement => {
  const link = (href: string, words: unknown): VNode => {
    hrefs.push(href);
    return <a href={href}>{words as string}</a>;
  };
  return render(<div>{markdown(text, { link })}</div>).container as HTMLElement;
};

test.each(PAGES.map(({ name }) => name))("%s is drawn whole, and its links lead somewhere", (name) => {
  const hrefs: string[] = [];
  const element = drawn(pageOf(name)?.text ?? "", hrefs);
  for (const code of element.querySelectorAll("code, pre")) code.remove();
  expect(element.textContent).not.toMatch(/\*\*|\]\(|^#|```|\|\s*-{3}|<\/?[a-z]+>/m);
  for (const href of hrefs) {
    const [, page = name, slug] = /^(?:([a-z-]+)\.md)?(?:#(.+))?$/.exec(href) ?? [];
    if (!/^([a-z-]+\.md)?(#.+)?$/.test(href)) continue; // of the repository, or the web
    const text = pageOf(page)?.text;
    expect(text, href).toBeDefined();
    if (slug)
      expect(
        blocksOf(text ?? "").map(([line = ""]) => slugOf(line)),
        href,
      ).toContain(slug);
  }
});

it("draws lists in lists, tables with code in them, and escapes", () => {
  const element = drawn("- one\n  more\n  - inner\n- two\n\n| a | b |\n|---|---|\n| `x|y` | 1 \\| 2 |\n\n1. first\n");
  expect(element.querySelectorAll("ul > li")).toHaveLength(3);
  expect(element.querySelector("ul ul")?.textContent).toBe("inner");
  expect(element.querySelector("li")?.textContent).toContain("one more");
  expect(element.querySelectorAll("ol > li")).toHaveLength(1);
});

it("finds sections that have every word, headings first", () => {
  expect(searchGuide("allan deviation")[0]).toMatchObject({
    page: "analysis",
    heading: "allan",
  });
  expect(searchGuide("cursor slope").map(({ page }) => page)).toContain("plots");
  expect(searchGuide("no such words at all")).toEqual([]);
});

it("leads by Enter to what is found", async () => {
  render(<Guide onClose={() => undefined} />);
  expect(find("article h3").textContent).toBe("First look");
  fireEvent.input(screen.getByRole("searchbox"), { target: { value: "allan" } });
  fireEvent.keyDown(screen.getByRole("searchbox"), { key: "Enter" });
  await waitFor(() => expect(find("article h3").textContent).not.toBe("First look"));
});
