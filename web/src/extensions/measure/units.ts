/** Products of units: what a slope and an integral are measured in. As server/extensions/analysis/signals/units.py multiplies them. */

type Powers = ReadonlyMap<string, number>;

const ABOVE = "⁰¹²³⁴⁵⁶⁷⁸⁹";
const PART = /^([^\d\s,·*/^()⁻⁰¹²³⁴-⁹][^\s,·*/^()⁻⁰¹²³⁴-⁹]*)(?:\^(-?\d+)|([⁻⁰¹²³⁴-⁹]+))?/u;

function powerOf(typed: string | undefined, raised: string | undefined): number {
  if (typed !== undefined) return Number(typed);
  if (raised === undefined) return 1;
  const digits = [...raised].map((sign) => (sign === "⁻" ? "-" : String(ABOVE.indexOf(sign)))).join("");
  return Number(digits);
}

/** Powers of the symbols of a unit; one that cannot be divided into symbols is one symbol. */
function parse(text: string): Powers {
  const powers = new Map<string, number>();
  const whole = text.trim();
  let [rest, sign] = [whole, 1];
  while (rest !== "") {
    const first = rest.charAt(0);
    if (first === "/") sign = -1;
    if ("·* /".includes(first) || rest === "1" || rest.startsWith("1/")) {
      rest = rest.slice(1);
      continue;
    }
    const found = PART.exec(rest);
    if (found === null) return new Map([[whole, 1]]);
    const [all, symbol = "", typed, raised] = found;
    powers.set(symbol, (powers.get(symbol) ?? 0) + sign * powerOf(typed, raised));
    rest = rest.slice(all.length);
  }
  return powers;
}

function shown(symbol: string, power: number): string {
  return power === 1 ? symbol : symbol + [...String(power)].map((digit) => ABOVE[Number(digit)]).join("");
}

/** A unit times a power of seconds: m/s² and −1 is m/s³, and 1 is m/s. */
export function timesSeconds(unit: string, power: number): string {
  const powers = new Map(parse(unit));
  powers.set("s", (powers.get("s") ?? 0) + power);
  const all = [...powers].filter(([, one]) => one !== 0);
  const above = all.filter(([, one]) => one > 0).map(([symbol, one]) => shown(symbol, one));
  const below = all.filter(([, one]) => one < 0).map(([symbol, one]) => shown(symbol, -one));
  return below.length === 0 ? above.join("·") : [above.join("·") || "1", ...below].join("/");
}
