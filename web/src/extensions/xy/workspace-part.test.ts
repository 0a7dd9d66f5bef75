/** The part of a workspace with the choices of the XY plot. */
import { test } from "vitest";
import { expectRefused, expectRestored } from "../../testing/workspace-part";
import "./workspace-part";

const XY = [
  { x: ["Acceleration", "x"], y: ["Temperature", "value"], pairing: "nearest" },
  { colour: "trail", draw: "points", isEqual: true, range: "cursors" },
];

test("choices are restored", () => expectRestored("xy", XY));

test("a broken choice is refused", () => expectRefused("xy", [{ x: ["Acceleration"] }, { colour: "rainbow" }, {}]));
