/** What of a message is a command to type: the server puts it between backticks, "Run `imuscope doctor`." Pure. */

export interface MessagePart {
  readonly text: string;
  readonly isCode: boolean;
}

/** The parts of a message in their order, without the backticks; one that stands alone is a character like others. */
export function messageParts(message: string): readonly MessagePart[] {
  return message
    .split(/`([^`]+)`/)
    .map((text, k) => ({ text, isCode: k % 2 === 1 }))
    .filter(({ text }) => text !== "");
}
