/** Durations from nanoseconds to days, as a number and a unit. */

const UNITS: readonly (readonly [number, string])[] = [
  [86_400, "d"],
  [3600, "h"],
  [60, "min"],
  [1, "s"],
  [1e-3, "ms"],
  [1e-6, "µs"],
  [1e-9, "ns"],
];

/** Three digits that mean something, and a unit: "2 s", "60 ns". */
export function shortDuration(seconds: number): string {
  const size = Math.abs(seconds);
  if (size < 1e-9) return "0 s";
  const [unit, name] = UNITS.find(([each]) => size >= each * 0.9995) ?? [1e-9, "ns"];
  return `${Number((size / unit).toPrecision(3))} ${name}`;
}
