/** A text with the place of a mistake marked; what is wrong is said elsewhere. */
import "./completion.css";

interface Props {
  readonly text: string;
  readonly begin: number;
  readonly end: number;
}

export function MarkedMistake({ text, begin, end }: Props) {
  return (
    <>
      {text.slice(0, begin)}
      <mark class="mistake">{text.slice(begin, end) || " "}</mark>
      {text.slice(end)}
    </>
  );
}
