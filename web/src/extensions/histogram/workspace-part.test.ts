/** The part of a workspace with the choices of the histogram. */
import { test } from "vitest";
import { expectRefused, expectRestored } from "../../testing/workspace-part";
import "./workspace-part";

const HISTOGRAMS = [
  { channel: "Acceleration", columns: ["x", "norm"], scale: "density", bins: 50 },
  { range: "cursors", within: 4, noCurve: true },
];

test("choices are restored", () => expectRestored("histogram", HISTOGRAMS));

test("a broken choice is refused", () => expectRefused("histogram", [{ bins: 0 }, { columns: [] }, { within: "4" }]));
