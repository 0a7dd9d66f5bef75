import { expect, it } from "vitest";
import { Silence } from "./silence";

const checked = (silence: Silence, from: number, to: number): (number | undefined)[] => {
  const found = [];
  for (let t = from; t <= to + 1e-9; t += 0.25) found.push(silence.ask(t));
  return found.filter((since) => since !== undefined);
};

it("a dead network is reported within two seconds, once, and so is its end", () => {
  const silence = new Silence();
  for (let t = 0; t <= 10; t += 0.5) {
    silence.receive(t);
    checked(silence, t, t + 0.25);
  }
  expect(checked(silence, 10.5, 12)).toEqual([10]);
  expect(checked(silence, 12.25, 30)).toEqual([]);
  expect(silence.receive(30)).toBe(true);
  expect(silence.receive(30.5)).toBe(false);
  expect(checked(silence, 30.5, 32.25)).toEqual([30.5]);
});

it("reports twice a second are not silence, nor is time in which the page was suspended", () => {
  const silence = new Silence();
  expect(silence.ask(0)).toBeUndefined(); // nothing received yet: connecting
  silence.receive(0);
  expect(checked(silence, 0.25, 1.5)).toEqual([]);
  expect(silence.ask(100)).toBeUndefined(); // suspended for a hundred seconds: queued messages are read first
  silence.receive(100.1);
  expect(checked(silence, 100.25, 101.5)).toEqual([]);
});
