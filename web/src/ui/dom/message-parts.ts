/** Commands in a message: the server puts them between backticks, "Run `imuscope doctor`." Pure. */

export interface MessagePart {
  readonly text: string;
  readonly isCode: boolean;
}

/** The parts of a message in order, without the backticks; a single backtick is an ordinary character. */
export function messageParts(message: string): readonly MessagePart[] {
  return message
    .split(/`([^`]+)`/)
    .map((text, k) => ({ text, isCode: k % 2 === 1 }))
    .filter(({ text }) => text !== "");
}
