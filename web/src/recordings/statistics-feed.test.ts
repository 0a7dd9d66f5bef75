import { expect, it, vi } from "vitest";
import { type StatisticsRequest, StatisticsFeed } from "./statistics-feed";

const window = (from: number, to: number): StatisticsRequest => ({ channels: [1, 2], from, to, base: "device" });
const answer = { 1: [{ n: 5, mean: null, sigma: 2, min: 0, max: 4 }] };

it("reports a summarised window, and requests exact figures when it stands still", async () => {
  let now = 0;
  const fetch = vi.fn(async () => answer);
  const feed = new StatisticsFeed("a", fetch as never, () => now);
  feed.want(window(0, 31));
  expect(feed.of(1, 0)).toBeUndefined();
  await vi.waitFor(() => expect(feed.of(1, 0)).toMatchObject({ n: 5, sigma: 2 }));
  expect(feed.of(1, 0)!.mean).toBeNaN();
  expect(feed.of(2, 0)).toBeUndefined();
  feed.want(window(0, 31));
  expect(fetch).toHaveBeenCalledTimes(1);
  now += 100;
  feed.want(window(5, 9)); // being zoomed: it is still moving
  expect(fetch).toHaveBeenCalledTimes(1);
  now += 300;
  feed.want(window(5, 9));
  expect(fetch).toHaveBeenCalledTimes(2);
});

it("gives figures only for the counted window", async () => {
  let now = 1000;
  const feed = new StatisticsFeed("a", (async () => answer) as never, () => now);
  feed.want(window(0, 30));
  await vi.waitFor(() => expect(feed.of(1, 0)).toBeDefined());
  now += 10;
  feed.want(window(0.5, 30.5));
  expect(feed.of(1, 0)).toBeDefined(); // played a little further
  feed.want(window(60, 90));
  expect(feed.of(1, 0)).toBeUndefined();
});
