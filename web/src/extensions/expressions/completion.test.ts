/** Completion at the caret, and the place of a mistake. */
import { expect, test } from "vitest";
import type { Channel } from "../../data/channels";
import type { ExpressionWords, SignalFigures } from "../../wire/routes";
import { quoted } from "../../signals/names";
import { completionsAt, expressionNames, mistakePlace } from "./completion";
import { columnsOf, usualName } from "./new-signal";

const WORDS: ExpressionWords = {
  functions: [
    { name: "norm", form: "norm(v)", doc: "Length of a vector." },
    { name: "lowpass", form: "lowpass(x, 10 Hz, order)", doc: "Butterworth low pass, of order 2." },
  ],
  units: ["m", "mm", "ms", "g", "m/s²"],
};
const NAMES = ["Acceleration", "Acceleration.x", "Normal force", '"Rate of turn.z"'];
const inserted = (text: string, caret = text.length): readonly string[] =>
  completionsAt(text, caret, NAMES, WORDS).map(({ insert }) => insert);

test("functions and signals are offered by their beginning or a part, functions first", () => {
  expect(inserted("1 + no")).toEqual(["norm()", "Normal force"]);
  expect(inserted("norm(acc")).toEqual(["Acceleration", "Acceleration.x"]);
  expect(inserted('norm("rate')).toEqual(['"Rate of turn.z"']);
  expect(inserted("")).toEqual([]);
});

test("after a number units are offered, and none in a name that ends with a digit", () => {
  expect(inserted("norm(Acceleration) > 3 m")).toEqual(["mm", "ms", "m/s²"]);
  expect(inserted("3")).toEqual([]);
  expect(inserted("sensor2 m")).not.toContain("mm");
});

test("a completion replaces the word at the caret only", () => {
  const [first] = completionsAt("no(Acc) * 2", 2, NAMES, WORDS);
  expect(first).toMatchObject({ from: 0, to: 2, insert: "norm()" });
});

test("names with spaces are quoted", () => {
  expect([quoted("Acceleration.x"), quoted("Rate of turn.z")]).toEqual(["Acceleration.x", '"Rate of turn.z"']);
});

test("signals that the page derives, the signal itself, and what other devices compute are not offered", () => {
  const columns = (...names: readonly string[]) => names.map((name) => ({ name, bits: [] }));
  const channel = (id: number, name: string, message: string, names: readonly string[]) =>
    ({ info: { id, device: "1", name, message, kind: "vector", columns: columns(...names) } }) as unknown as Channel;
  const all = [
    channel(1, "Acceleration", "M", ["x", "y", "norm"]),
    channel(-2, "Euler", "M", ["roll", "pitch"]),
    channel(3, "Total", "expression", ["value"]),
    channel(4, "Pressure", "M", ["value"]),
  ];
  const sent = ["Acceleration", "Acceleration.x", "Acceleration.y"];
  expect(expressionNames(all, "1")).toEqual([...sent, "Total", "Pressure"]);
  expect(expressionNames(all, "1", "Total")).toEqual([...sent, "Pressure"]);
  expect(expressionNames(all, "2")).toEqual([...sent, "Pressure"].map((name) => `"1/${name}"`));
});

test("Euler angles that the page derives from a quaternion are offered: the server computes them, too", () => {
  const of = (id: number, name: string, kind: string, columns: readonly string[]): Channel =>
    ({
      info: { id, name, kind, device: "1", message: "M", columns: columns.map((own) => ({ name: own, bits: [] })) },
    }) as unknown as Channel;
  const angles = of(-5, "EulerAngles", "euler", ["roll", "yaw"]);
  const turned = of(4, "Quaternion", "quaternion", ["w", "x"]);
  expect(expressionNames([turned, angles], "1")).toContain("EulerAngles.yaw");
  expect(expressionNames([of(4, "Matrix", "matrix", ["a", "b"]), angles], "1")).not.toContain("EulerAngles.yaw");
});

test("a mistake is marked from its character to the end of the word", () => {
  const text = 'norm(Foo.x) + "Rate of';
  const marked = (message: string): string => {
    const place = mistakePlace(message, text);
    return place ? text.slice(place.begin, place.end) : "none";
  };
  expect(marked("Signal Foo.x not found. (character 6)")).toBe("Foo.x");
  expect(marked("Not closed. (character 15)")).toBe('"Rate of');
  expect(marked("The end. (character 99)")).toBe("");
  expect(marked("The server is silent.")).toBe("none");
});

test("the columns of a new channel, and its usual name", () => {
  const figures = (...signals: readonly string[]) => signals.map((signal) => ({ signal }) as SignalFigures);
  expect(columnsOf(figures("(norm(Acceleration))"))).toEqual(["value"]);
  expect(columnsOf(figures("((Acc - Acc)).x", "((Acc - Acc)).y"))).toEqual(["x", "y"]);
  expect(usualName('norm("2/Rate of turn.z") / 2')).toBe("norm( 2 Rate of turn z ) 2");
  expect(usualName("x".repeat(99))).toHaveLength(60);
});
