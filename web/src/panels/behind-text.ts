/** Sentences about what is behind: where, why if that is known, what to do. */
import type { BehindBy, Part } from "../data/behind";
import { age } from "../ui/format/format";
import { TEXT } from "../texts/panels";

/** The cause, as far as it is known, for a line of its own. */
export function behindCause({ part, reason }: BehindBy): string {
  return part === "decoding" && reason !== "" ? TEXT.behindReason[reason] : TEXT.behindIn[part];
}

/** One sentence: by how much, and why. */
export function behindWords(behind: BehindBy): string {
  const { value, unit } = age(behind.total);
  return TEXT.behindBy(value, unit, behindCause(behind));
}

/** The times of all parts, and what helps. */
export function behindHint({ parts, part }: BehindBy): string {
  const words = (Object.keys(parts) as Part[]).map((one) => {
    const { value, unit } = age(parts[one]);
    return `${TEXT.behindPart[one]} ${value} ${unit}`;
  });
  return `${words.join(" · ")}. ${TEXT.behindRemedy[part]}`;
}
