// @vitest-environment happy-dom
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { keepAddress } from "./keep-address";

let view: string | undefined;
let writes: string[];
let stop: () => void;

beforeEach(() => {
  vi.useFakeTimers();
  history.replaceState(null, "", "#/?span=1");
  [view, writes] = ["#/?span=1", []];
  stop = keepAddress(
    () => view,
    (hash) => writes.push(hash),
  );
});
afterEach(() => {
  stop();
});

it("is written as soon as the view stands still", () => {
  view = "#/?span=2";
  vi.advanceTimersByTime(200);
  expect(location.hash).toBe("#/?span=2");
  vi.advanceTimersByTime(5000);
  expect(writes).toEqual(["#/?span=2"]);
});

it("is written once a second while the view moves, and at its end", () => {
  const moving = setInterval(() => (view = `#/?t0=${Date.now()}`), 20);
  vi.advanceTimersByTime(10_000);
  expect(writes).toHaveLength(10);
  clearInterval(moving);
  vi.advanceTimersByTime(200);
  expect(location.hash).toBe(view);
});

it("is left alone while it is another page's", () => {
  view = undefined;
  history.replaceState(null, "", "#/configure");
  vi.advanceTimersByTime(5000);
  expect(location.hash).toBe("#/configure");
  expect(writes).toEqual([]);
});

it("is not written over an address whose event is still to come", () => {
  view = "#/recordings/drive?t=1";
  vi.advanceTimersByTime(300);
  expect(location.hash).toBe(view);
  history.replaceState(null, "", "#/live"); // as `go` does
  vi.advanceTimersByTime(100);
  expect(location.hash).toBe("#/live");
  view = undefined; // the event has come
  vi.advanceTimersByTime(5000);
  expect(location.hash).toBe("#/live");
});

it("is written once, whatever the browser's spelling of it", () => {
  view = "#/?a=é b";
  vi.advanceTimersByTime(5000);
  expect(writes).toEqual(["#/?a=é b"]);
});
