// @vitest-environment happy-dom
import { expect, it } from "vitest";
import type { Channel } from "../data/channels";
import { ringOf } from "../testing/samples";
import { el, LiveText } from "../ui/dom/dom";
import { showAge, staleness, widen } from "./values";

/** A channel with a sample every `step` seconds up to 100 s. */
function upTo(step: number): { readonly channel: Channel } {
  const times = Array.from({ length: 20 }, (_, k) => 100 - (19 - k) * step);
  return { channel: { info: {} as Channel["info"], ring: ringOf(times, [times]) } };
}

it("the value of a stopped stream is not shown as current", () => {
  const now = { word: "now" } as const;
  expect(staleness(upTo(0.01), now, 101)).toBeUndefined();
  expect(staleness(upTo(0.01), now, 280)).toBe("3 min");
  expect(staleness(upTo(10), now, 130)).toBeUndefined(); // rare, and on time
  expect(staleness(upTo(10), now, 160)).toBe("60 s");
  expect(staleness(upTo(0.01), { word: "cursor" }, 280)).toBeUndefined(); // of another moment, which is shown
});

it("the age of an old value does not stand in the column of σ", () => {
  const [mean, sd] = [new LiveText(), new LiveText()];
  const row = el("tr", {}, ...[mean, sd].map(({ node }) => el("td", {}, node)));
  sd.set("0.02");
  showAge({ mean, sd }, "5.6 s");
  const [first, second] = [...row.children] as HTMLTableCellElement[];
  expect([first?.textContent, first?.colSpan, second?.hidden]).toEqual(["5.6 s ago", 2, true]);
  showAge({ mean, sd }, undefined);
  expect([first?.colSpan, second?.hidden]).toEqual([1, false]);
});

it("a number that is too long for its column has that of its mean", () => {
  const lives = [new LiveText(), new LiveText(), new LiveText()] as const;
  const [now, mean, sd] = lives;
  const tr = el("tr", {}, ...lives.map(({ node }) => el("td", {}, node)));
  now.set("1 500 000 000.000");
  sd.set("0.63");
  for (let n = 0; n < 2; n++) widen({ now, mean });
  expect([...tr.children].map((cell) => [cell.textContent, (cell as HTMLTableCellElement).colSpan])).toEqual([
    ["1 500 000 000.000", 2],
    ["0.63", 1],
  ]);
});
