import { describe, expect, it } from "vitest";
import { actionFor, belongsToControl, keyGroups, type KeyPress, nextSpan, SPANS } from "./keys";

const press = (key: string, more: Partial<KeyPress> = {}): KeyPress => ({
  key,
  code: "",
  shiftKey: false,
  ctrlKey: false,
  altKey: false,
  metaKey: false,
  ...more,
});

describe("actionFor", () => {
  it("maps the keys of the design", () => {
    expect(actionFor(press(" "))).toEqual({ do: "playPause" });
    expect(actionFor(press("ArrowLeft"))).toEqual({ do: "pan", windows: -0.1 });
    expect(actionFor(press("ArrowRight", { shiftKey: true }))).toEqual({ do: "pan", windows: 1 });
    expect(actionFor(press("F"))).toEqual({ do: "fit" });
    expect(actionFor(press("?", { shiftKey: true }))).toEqual({ do: "help" });
  });
  it("records with Shift only", () => {
    expect(actionFor(press("r"))).toEqual({ do: "askRecord" });
    expect(actionFor(press("R"))).toEqual({ do: "askRecord" }); // caps lock
    expect(actionFor(press("R", { shiftKey: true }))).toEqual({ do: "record" });
  });
  it("reads digits by key position, because Shift changes their character", () => {
    expect(actionFor(press("!", { code: "Digit1", shiftKey: true }))).toEqual({ do: "series", index: 0, alone: true });
    expect(actionFor(press("3", { code: "Numpad3" }))).toEqual({ do: "series", index: 2, alone: false });
  });
  it("ignores the browser's own shortcuts", () => {
    expect(actionFor(press("f", { ctrlKey: true }))).toBeUndefined();
    expect(actionFor(press("[", { metaKey: true }))).toBeUndefined();
    expect(actionFor(press("q"))).toBeUndefined();
  });
  it("lists no key twice", () => {
    const printed = keyGroups().flatMap(({ lines }) => lines.flatMap((line) => line.keys));
    expect(new Set(printed).size).toBe(printed.length);
  });
});

describe("nextSpan", () => {
  it("steps through the menu from any position and stops at its ends", () => {
    expect(nextSpan(20, true)).toBe(30);
    expect(nextSpan(20, false)).toBe(10);
    expect(nextSpan(17, true)).toBe(20);
    expect(nextSpan(SPANS[0] ?? 0, false)).toBe(SPANS[0]);
    expect(nextSpan(4000, true)).toBe(4000);
    expect(nextSpan(0.2, false)).toBe(0.2);
  });
});

describe("belongsToControl", () => {
  it("keeps typing in a field, and Space on a button", () => {
    expect(belongsToControl("INPUT", "text", false, press("f"))).toBe(true);
    expect(belongsToControl("SELECT", "", false, press("ArrowLeft"))).toBe(true);
    expect(belongsToControl("BUTTON", "", false, press(" "))).toBe(true);
    expect(belongsToControl("BUTTON", "", false, press("f"))).toBe(false);
    expect(belongsToControl("BODY", "", false, press(" "))).toBe(false);
  });
});
