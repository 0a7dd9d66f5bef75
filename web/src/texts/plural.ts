/** A count and its noun, in one place: what a language with other plural forms would change. */
import { number } from "../ui/format/format";

/** The form of a noun that belongs to a number: plural(2, "gap") is "gaps". */
export function plural(n: number, one: string, many = `${one}s`): string {
  return n === 1 ? one : many;
}

/** "1 gap", "3 gaps", "1 204 samples". */
export function count(n: number, one: string, many = `${one}s`): string {
  return `${number(n, 0)} ${plural(n, one, many)}`;
}

const NUMERALS = ["No", "One", "Two", "Three", "Four", "Five", "Six", "Seven", "Eight", "Nine"];

/** A small number at the start of a text, as a word. */
export const numeral = (n: number): string => NUMERALS[n] ?? number(n, 0);
