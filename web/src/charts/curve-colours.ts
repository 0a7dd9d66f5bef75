/** Colours of curves: x, y and z have those of the axes. */
const AXES: Readonly<Record<string, string>> = { x: "axis-x", y: "axis-y", z: "axis-z" };
const OTHERS = ["axis-x", "axis-y", "axis-z", "axis-n"];

/** The part of a signal's name that distinguishes it from the others: "x" of "Acceleration.x". */
export function curveName(name: string): string {
  const column = /\.(\w+)$/.exec(name)?.[1];
  return column ?? name;
}

export function colourOf(name: string, at: number): string {
  return AXES[curveName(name)] ?? OTHERS[at % OTHERS.length] ?? "axis-n";
}
