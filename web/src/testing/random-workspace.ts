/** Random workspaces, for tests: every part that the page has, each now and then at its default. */

/** Numbers in [0, 1) that are the same for a seed (mulberry32). */
export function seeded(seed: number): () => number {
  let state = seed;
  return () => {
    state = (state + 0x6d2b79f5) | 0;
    let t = Math.imul(state ^ (state >>> 15), 1 | state);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return ((t ^ (t >>> 14)) >>> 0) / 4294967296;
  };
}

export type Random = () => number;

export const oneOf = <T>(next: Random, values: readonly T[]): T => values[Math.floor(next() * values.length)] as T;
/** Some of the values, in their order. */
export const someOf = <T>(next: Random, values: readonly T[]): readonly T[] => values.filter(() => next() < 0.4);

const SERIES = ["Acceleration.x", "Acceleration.y", "Rate of turn.z", "Temperature.°C,odd&name"];
const NORMS = ["Acceleration.norm", "Rate of turn.norm"];
const PLOTS = ["Position/ECEF", "Pressure", "Temperature"];

const CUSTOM = ["1/Acceleration/x,2/Acceleration/x", "@1/Pressure,1/Free%20acceleration/z", "1.102/a%2Fb/y"];
const PANELS = ["attitude", "events", "health", "values", "lanes", "track", "analysis", "spectrum", "allan"];
const TILES = [
  { along: "row", parts: ["plots", "allan"], shares: [2, 1] },
  {
    along: "column",
    parts: ["attitude", { along: "row", parts: ["plots", { along: "column", parts: ["track", "xy"] }] }],
  },
];
const AREAS = ["main", "side", "below"];

function randomLayout(next: Random): Record<string, unknown> {
  const chosen = someOf(next, PANELS).map((id) => [
    id,
    {
      ...(next() < 0.5 ? { area: oneOf(next, AREAS) } : {}),
      ...(next() < 0.5 ? { shown: next() < 0.5 } : {}),
      height: 60 + Math.floor(next() * 500),
    },
  ]);
  const order = someOf(next, AREAS).map((area) => [area, someOf(next, PANELS)]);
  return {
    ...(chosen.length > 0 ? { panels: Object.fromEntries(chosen) } : {}),
    ...(order.length > 0 ? { order: Object.fromEntries(order) } : {}),
    ...(next() < 0.5 ? { maximised: oneOf(next, PANELS) } : {}),
    ...(next() < 0.5 ? { tiles: oneOf(next, TILES) } : {}),
    belowHeight: 60 + Math.floor(next() * 500),
    sideWidth: 240 + Math.floor(next() * 400),
  };
}

const AXES = [
  { Acceleration: { range: [-20, 20.5] } },
  { Pressure: { isLog: true }, Temperature: { range: [1, 5], isLog: true } },
];

const ORDERS = [
  { order: ["Temperature", "Acceleration", "custom:p1"], heights: { Acceleration: 200, Temperature: 40 } },
  { heights: { "Position/ECEF": 333 } },
  { order: ["Pressure"] },
  { tiles: { Acceleration: "plots/2" } },
];

export function randomParts(next: Random): Record<string, unknown> {
  const hide = someOf(next, SERIES);
  const show = someOf(next, NORMS);
  const plots = someOf(next, PLOTS);
  const custom = someOf(next, CUSTOM);
  const t0 = 1_700_000_000 + Math.round(next() * 1e6);
  const time = (): number | null => (next() < 0.5 ? null : t0 + next());
  return {
    range: next() < 0.5 ? { span: oneOf(next, [0.005, 5, 20, 3600]) } : { t0, t1: t0 + 1 + Math.floor(next() * 1000) },
    cursors: { reading: time(), measuring: time() },
    ...(hide.length + show.length > 0 ? { series: { hide, show } } : {}),
    ...(plots.length > 0 ? { extraPlots: plots } : {}),
    ...(custom.length > 0 ? { customPlots: custom } : {}),
    ...(next() < 0.5 ? { yAxes: oneOf(next, AXES) } : {}),
    ...(next() < 0.5 ? { plotOrder: oneOf(next, ORDERS) } : {}),
    ...(next() < 0.5 ? { timeBase: "arrival" } : {}),
    ...(next() < 0.5 ? { frame: oneOf(next, ["ENU", "NED", "NWU"]) } : {}),
    ...(next() < 0.5 ? { sideFolded: true } : {}),
    ...(next() < 0.7 ? { layout: randomLayout(next) } : {}),
  };
}
