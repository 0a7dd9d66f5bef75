import { describe, expect, it } from "vitest";
import { roundLength } from "./track";

describe("roundLength", () => {
  it("is the longest 1, 2 or 5 that fits", () => {
    expect([0.3, 1, 4.9, 5, 19, 137].map(roundLength)).toEqual([0.2, 1, 2, 5, 10, 100]);
  });
});
