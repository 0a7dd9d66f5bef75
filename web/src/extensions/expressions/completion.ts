/** Completion of an expression: what may stand at the caret, and where the server sees a mistake. */
import type { Completion } from "../../ui/completion/use-completion";
import type { Channel } from "../../data/channels";
import type { ExpressionWords } from "../../wire/routes";
import { plottable } from "../../signals/custom-plots";
import { isComputed, isOfQuaternion, quoted } from "../../signals/names";

const MAX_SUGGESTIONS = 8;
/**
 * Signals that an expression may use: those of its device, but not itself, and those that other devices send. Of what the page derives
 * the server knows the Euler angles of a quaternion.
 */
export function expressionNames(channels: readonly Channel[], device: string, self = ""): readonly string[] {
  const sent = channels.filter((one) => one.info.id >= 0 || isOfQuaternion(one, channels));
  const own = sent.filter(({ info }) => info.device === device && !(isComputed(info) && info.name === self));
  const others = sent.filter(({ info }) => info.device !== device && !isComputed(info));
  return [...namesOf(own, ""), ...others.flatMap((one) => namesOf([one], `${one.info.device}/`))];
}

function namesOf(channels: readonly Channel[], prefix: string): readonly string[] {
  return channels.flatMap((channel) => {
    const { columns } = channel.info;
    const name = prefix + channel.info.name;
    const own = plottable(channel).flatMap((c) => columns[c] ?? []);
    const plain = own.filter((column) => column.name !== "norm").map((column) => quoted(`${name}.${column.name}`));
    return own.length > 1 ? [quoted(name), ...plain] : [quoted(name)];
  });
}

/** What may complete the word before the caret; after a number, units. */
export function completionsAt(
  text: string,
  caret: number,
  names: readonly string[],
  words: ExpressionWords | undefined,
): readonly Completion[] {
  const before = text.slice(0, caret);
  const number = /(?:\d\.?|\.\d)\s*([^\s\d()+\-*^<>=!,]*)$/u.exec(before);
  const beside = /[\p{L}_]\w*$/u.exec(before)?.[0] ?? "";
  if (number && !/[\p{L}_]\d*$/u.test(before.slice(0, before.length - (number[1]?.length ?? 0)).trimEnd())) {
    const start = number[1] ?? "";
    const from = caret - start.length;
    const units = (words?.units ?? []).filter((unit) => start !== "" && unit.startsWith(start) && unit !== start);
    return units.slice(0, MAX_SUGGESTIONS).map((unit) => ({ label: unit, doc: "", insert: unit, from, to: caret }));
  }
  const word = /"[^"]*$|[\p{L}_][\w.]*$/u.exec(before)?.[0] ?? beside;
  if (word === "") return [];
  const from = caret - word.length;
  const search = word.replace(/^"/, "").toLowerCase();
  const functions = (words?.functions ?? [])
    .filter(({ name }) => name.startsWith(search) && !word.startsWith('"'))
    .map(({ name, form, doc }) => ({ label: form, doc, insert: `${name}()`, from, to: caret }));
  const rank = (name: string): number => name.toLowerCase().replace(/^"/, "").indexOf(search);
  const signals = names
    .filter((name) => rank(name) >= 0 && name !== word)
    .sort((a, b) => Math.min(1, rank(a)) - Math.min(1, rank(b)))
    .map((name) => ({ label: name, doc: "", insert: name, from, to: caret }));
  return [...functions.slice(0, 4), ...signals].slice(0, MAX_SUGGESTIONS);
}

/** Where a mistake is: from the character that the server names to the end of the word there. */
export function mistakePlace(
  message: string,
  text: string,
): { readonly begin: number; readonly end: number } | undefined {
  const found = /\(character (\d+)\)/.exec(message);
  if (!found) return undefined;
  const begin = Math.min(Number(found[1]) - 1, text.length);
  const word = /^("[^"]*"?|[\p{L}_\d][\w.]*|.)/u.exec(text.slice(begin));
  return { begin, end: begin + (word?.[0].length ?? 0) };
}
