import { describe, expect, it } from "vitest";
import type { Channel } from "../../data/channels";
import type { BitsInfo, ChannelInfo } from "../../wire/types";
import { fixLine, metresOf, positionOf, qualityOf, facetWords } from "./position";

type Named = readonly (readonly [
  name: string,
  value: number,
  bits?: readonly Partial<BitsInfo>[],
  choices?: Readonly<Record<string, string>>,
])[];

function channel(name: string, kind: ChannelInfo["kind"], columns: Named, group = "", title = name): Channel {
  const infos = columns.map(([column, , bits = [], choices = {}]) => ({
    name: column,
    bits,
    choices,
    unit: column === "hAcc" ? "mm" : "",
  }));
  const ring = { length: 1, value: (c: number) => columns[c]?.[1] ?? NaN, indexAt: () => 0, arrival: () => 1 };
  return {
    info: { name, kind, title, group, message: group || "MTData2", columns: infos },
    ring,
  } as unknown as Channel;
}

const FIX = { name: "FIX", low: 8, width: 5, choices: { 3: "3D", 12: "RTK_FIX" } };
const receiver = [
  channel(
    "GPS1.lla",
    "vector",
    [
      ["lat", 52],
      ["lon", 6],
      ["alt", 70],
    ],
    "GPS1 POS",
    "Position",
  ),
  channel(
    "GPS1.status",
    "status",
    [["value", (12 << 8) | 17, [{ name: "NUM_SATS_USED", low: 0, width: 8, choices: {} }, FIX]]],
    "GPS1 POS",
    "Status",
  ),
  channel(
    "GPS1",
    "record",
    [
      ["hAcc", 14],
      ["vAcc", 0.021],
      ["satsUsed", 17],
    ],
    "GPS1 POS",
  ),
];
const ins = channel(
  "INS.lla",
  "vector",
  [
    ["lat", 52.1],
    ["lon", 6.1],
  ],
  "INS 1",
  "Position",
);
const base = channel(
  "RTK.baseLla",
  "vector",
  [
    ["lat", 52.1],
    ["lon", 6.1],
  ],
  "RTK",
  "Base position",
);

describe("positionOf", () => {
  it("takes the receiver's own position and its status", () => {
    const position = positionOf([base, ins, ...receiver])!;
    expect(position.channel).toBe(receiver[0]);
    expect(fixLine(position, 0)).toBe("RTK fix · 17 sat");
    expect(metresOf(position, position.horizontal, 0)).toBe(0.014);
  });
  it("takes the available position and the fix of the status word", () => {
    const word = channel("StatusWord", "status", [
      [
        "value",
        4 | (1 << 27),
        [
          { name: "GnssFix", low: 2, width: 1, choices: {} },
          { name: "RtkStatus", low: 27, width: 2, choices: { 1: "floating" } },
        ],
      ],
    ]);
    const position = positionOf([
      channel("LatLon", "vector", [
        ["latitude", 1],
        ["longitude", 2],
      ]),
      word,
    ])!;
    expect(fixLine(position, 0)).toBe("fix · RTK floating");
    expect(facetWords(position, position.fix, -1)).toBe("");
    expect(positionOf([base])).toBeUndefined();
  });
});

describe("qualityOf", () => {
  it("reads the status texts of any family", () => {
    const said = [
      ["none", ""],
      ["RTK fix", ""],
      ["3D", "fixed"],
      ["RTK float", ""],
      ["3D", "floating"],
      ["2D", ""],
      ["dead reckoning only", ""],
      ["3D", "none"],
      ["", ""],
    ] as const;
    expect(said.map(([fix, carrier]) => qualityOf(fix, carrier))).toEqual([
      "none",
      "fixed",
      "fixed",
      "float",
      "float",
      "poor",
      "poor",
      "plain",
      "plain",
    ]);
  });
});
