/** Filters, groups and order of the fleet, against the obvious way to compute them. */
import { describe, expect, it } from "vitest";
import { deviceWith, robotWith } from "./fixtures";
import type { RobotSummary } from "../../../wire/routes";
import { fleetHref, readRobotPlace, START } from "./address";
import { COLUMNS, lossCell } from "./columns";
import { healthOf } from "./conditions";
import {
  arrange,
  byName,
  type RobotChoice,
  countAll,
  GROUPINGS,
  inShown,
  robotLines,
  SHOWN,
  WORST_FIRST,
} from "./order";
import { robotOf, type Robot } from "./robots";

function dice(seed: number): (sides: number) => number {
  let state = seed * 7919 + 17;
  return (sides) => {
    state = (Math.imul(state, 1_103_515_245) + 12_345) & 0x7fffffff;
    return (state >>> 8) % sides;
  };
}

function anyRobot(roll: (sides: number) => number, index: number): RobotSummary {
  const pick = <T>(...all: readonly T[]): T => all[roll(all.length)] as T;
  return robotWith({
    name: `amr-${index}`,
    group: pick("Harbour", "Orchard", ""),
    state: pick("live", "live", "live", "lost"),
    since: roll(5),
    version: pick("1.0.0", "0.9.4"),
    disk_free_bytes: pick(null, 1e9, 2e11),
    latency_ms: pick(null, 4, 20),
    settings: pick("unknown", "as-profile", "drifted"),
    drifted: roll(3),
    alarms: pick(
      [],
      [
        {
          name: "Hot",
          level: pick("warning", "error"),
          state: pick("raised", "acknowledged", "missing"),
          device: "1",
          condition: "",
          acknowledged_by: "",
        },
      ],
    ),
    devices: Array.from({ length: roll(3) }, (_, i) =>
      deviceWith({
        id: String(i),
        serial_number: `${roll(4)}`,
        product: pick("IMX-5", "MTi-630"),
        rate: pick(100, 400),
        loss: pick(null, 0, 0, 0.01, 0.2),
        fix: pick("", "3D", "no fix"),
        temperature: pick(null, 20, 40),
        status: pick("live", "live", "lost"),
      }),
    ),
  });
}

const fleet = (roll: (sides: number) => number): Robot[] =>
  Array.from({ length: roll(30) }, (_, i) => robotOf(anyRobot(roll, i)));

describe("the list", () => {
  it("has each robot that the filter and the search let through once, and no other", () => {
    for (let seed = 0; seed < 150; seed++) {
      const roll = dice(seed);
      const robots = fleet(roll);
      const choice: RobotChoice = {
        sort: COLUMNS[roll(COLUMNS.length)]?.name ?? "state",
        descending: roll(2) === 0,
        shown: SHOWN[roll(SHOWN.length)] ?? "all",
        query: ["", "amr-1", "imx-5 harbour", "HOT", "nothing"][roll(5)] ?? "",
        grouping: GROUPINGS[roll(GROUPINGS.length)] ?? "none",
      };
      const words = choice.query.toLowerCase().split(" ");
      const wanted = robots.filter(
        (robot) =>
          inShown(robot, choice.shown) &&
          words.every((word) => JSON.stringify(robot.summary).toLowerCase().includes(word)),
      );
      const groups = arrange(robots, choice);
      const listed = groups.flatMap(({ names }) => names);
      expect([...listed].sort()).toEqual(wanted.map(({ summary }) => summary.name).sort());
      expect(new Set(groups.map(({ title }) => title)).size).toBe(groups.length);
      expect(groups.every(({ names }) => names.length > 0)).toBe(true);
      const lines = robotLines(groups, choice, new Set(), () => 0);
      expect(lines.length).toBe(listed.length + (choice.grouping === "none" ? 0 : groups.length));
    }
  });

  it("is sorted by the column, missing figures last, equals by name, and stays so when sorted again", () => {
    for (let seed = 0; seed < 150; seed++) {
      const roll = dice(seed);
      const robots = fleet(roll);
      const column = COLUMNS[roll(COLUMNS.length)];
      if (!column) continue;
      const choice: RobotChoice = { ...WORST_FIRST, sort: column.name, descending: roll(2) === 0 };
      const [group] = arrange(robots, choice);
      const names = group?.names ?? [];
      const robotNamed = new Map(robots.map((robot) => [robot.summary.name, robot]));
      for (let i = 1; i < names.length; i++) {
        const [a, b] = [names[i - 1] ?? "", names[i] ?? ""];
        const [x, y] = [a, b].map((name) => column.key(robotNamed.get(name) as Robot));
        if (x === undefined) expect(y).toBeUndefined();
        else if (y !== undefined && x !== y) {
          const isRising = typeof x === "number" ? x < (y as number) : byName(x, String(y)) < 0;
          expect(isRising).toBe(!choice.descending);
        }
        if (x === y) expect(byName(a, b)).toBeLessThan(0);
      }
      const shuffled = [...robots].sort(() => roll(3) - 1);
      expect(arrange(shuffled, choice)).toEqual(arrange(robots, choice));
    }
  });

  it("begins with the robot that needs somebody most", () => {
    const worst: readonly Partial<RobotSummary>[] = [
      { name: "b", state: "lost", since: 200 },
      {
        name: "a",
        state: "lost",
        since: 100,
        alarms: [{ name: "Hot", level: "error", state: "raised", device: "", condition: "", acknowledged_by: "" }],
      },
      {
        name: "d",
        alarms: [{ name: "Hot", level: "error", state: "raised", device: "", condition: "", acknowledged_by: "" }],
      },
      { name: "e", devices: [deviceWith({ status: "lost" })] },
      {
        name: "f",
        alarms: [{ name: "Hot", level: "warning", state: "missing", device: "", condition: "", acknowledged_by: "" }],
      },
      { name: "h", devices: [deviceWith({ loss: 0.1 })] },
      { name: "g", devices: [deviceWith({ loss: 0.02 })] },
      { name: "i", devices: [deviceWith({ fix: "No fix" })] },
      { name: "j", devices: [deviceWith({ rate: 300 })] },
      { name: "k", disk_free_bytes: 1e9 },
      { name: "l", settings: "drifted", drifted: 2 },
      {
        name: "m",
        alarms: [
          { name: "Hot", level: "error", state: "acknowledged", device: "", condition: "", acknowledged_by: "" },
        ],
      },
      { name: "c" },
    ];
    const robots = [...worst].reverse().map((part) => robotOf(robotWith(part)));
    expect(arrange(robots, WORST_FIRST)[0]?.names.join("")).toBe("badefhgijklmc");
  });

  it("orders names as people count, and puts a robot with two products in one group", () => {
    const robots = ["amr-10", "amr-9"].map((name) => robotOf(robotWith({ name })));
    const byNames: RobotChoice = { ...WORST_FIRST, sort: "name", descending: false };
    expect(arrange(robots, byNames)[0]?.names).toEqual(["amr-9", "amr-10"]);
    const both = robotOf(
      robotWith({ devices: [deviceWith({ product: "MTi-630" }), deviceWith({ product: "IMX-5" })] }),
    );
    expect(arrange([both], { ...WORST_FIRST, grouping: "product" })).toEqual([
      { title: "IMX-5 + MTi-630", names: ["amr-001"] },
    ]);
  });

  it("counts what each filter shows", () => {
    const roll = dice(5);
    const robots = Array.from({ length: 100 }, (_, i) => robotOf(anyRobot(roll, i)));
    const counts = countAll(robots);
    for (const shown of SHOWN) expect(counts[shown]).toBe(robots.filter((robot) => inShown(robot, shown)).length);
    expect(counts.all).toBe(counts.live + counts.lost);
  });
});

describe("health", () => {
  it("of a lost robot is that it is lost: its figures are from before", () => {
    const robot = robotWith({ state: "lost", devices: [deviceWith({ loss: 0.5 })] });
    expect(healthOf(robot).conditions).toEqual(["lost"]);
  });

  it("never shows a loss as none", () => {
    expect([null, 0, 1e-7, 0.0031, 0.2].map((loss) => lossCell(loss).text)).toEqual([
      "—",
      "0",
      "<\u20090.01",
      "0.31",
      "20.0",
    ]);
  });
});

describe("the address", () => {
  it("says what is shown, and nothing else", () => {
    expect(fleetHref(START)).toBe("#/fleet");
    for (let seed = 0; seed < 200; seed++) {
      const roll = dice(seed);
      const place = {
        sort: COLUMNS[roll(COLUMNS.length)]?.name ?? START.sort,
        descending: roll(2) === 0,
        shown: SHOWN[roll(SHOWN.length)] ?? "all",
        query: ["", "a b", "ü&=#?"][roll(3)] ?? "",
        grouping: GROUPINGS[roll(GROUPINGS.length)] ?? "none",
        view: (["list", "map"] as const)[roll(2)] ?? "list",
        robot: ["", "amr 7/ä"][roll(2)] ?? "",
      };
      const href = fleetHref(place);
      expect(readRobotPlace(href.split("?")[1] ?? "")).toEqual(place);
    }
  });

  it("that is unknown shows all", () => {
    expect(readRobotPlace("sort=colour&show=pink&by=moon&order=sideways")).toEqual(START);
  });
});
