import { describe, expect, it } from "vitest";
import { fitView, roundLength, stretches, type TrackPoint, zoomedTrack } from "./track";

const point = (east: number, north: number, quality: TrackPoint["quality"] = "plain"): TrackPoint => ({
  at: [east, north],
  quality,
});

describe("roundLength", () => {
  it("is the longest 1, 2 or 5 that fits", () => {
    expect([0.3, 1, 4.9, 5, 19, 137].map(roundLength)).toEqual([0.2, 1, 2, 5, 10, 100]);
  });
});

describe("stretches", () => {
  it("join where the fix type changes, but not over a gap or missing fix", () => {
    const found = stretches([
      point(0, 0),
      point(1, 0),
      point(2, 0, "fixed"),
      undefined,
      point(5, 0, "fixed"),
      point(6, 0, "none"),
      point(7, 0),
    ]);
    expect(found).toEqual([
      {
        quality: "plain",
        points: [
          [0, 0],
          [1, 0],
        ],
      },
      {
        quality: "fixed",
        points: [
          [1, 0],
          [2, 0],
        ],
      },
      { quality: "fixed", points: [[5, 0]] },
      { quality: "plain", points: [[7, 0]] },
    ]);
  });
});

describe("the view", () => {
  it("shows the whole track, and at least two metres", () => {
    expect(fitView([point(0, 0), undefined, point(100, 50)], 240, 224)).toEqual({ middle: [50, 25], scale: 2 });
    expect(fitView([point(3, 4)], 240, 224)).toEqual({ middle: [3, 4], scale: 100 });
    expect(fitView([undefined], 240, 224)).toBeUndefined();
  });
  it("zooms about the pointer: the position under it stays", () => {
    const [w, h, u, v] = [200, 100, 150, 20];
    const before = { middle: [10, 20], scale: 2 } as const;
    const after = zoomedTrack(before, 3, u, v, w, h);
    const under = (view: typeof before | typeof after): number[] => [
      view.middle[0] + (u - w / 2) / view.scale,
      view.middle[1] - (v - h / 2) / view.scale,
    ];
    expect(after.scale).toBe(6);
    under(after).forEach((value, k) => expect(value).toBeCloseTo(under(before)[k]!, 9));
  });
});
