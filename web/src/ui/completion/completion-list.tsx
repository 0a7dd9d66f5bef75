/** The list of completions under a field. */
import type { Offer } from "./use-completion";
import { COMMON } from "../../texts/common";
import "./completion.css";

interface Props {
  /** Of the list, for aria-controls. */
  readonly id: string;
  readonly offer: Offer;
}

export function CompletionList({ id, offer }: Props) {
  return (
    <div id={id} role="listbox" aria-label={COMMON.completions} class="completions">
      {offer.all.value.map((one, k) => (
        <div
          key={`${one.insert} ${one.label}`}
          id={optionId(id, k)}
          role="option"
          class="ellipsis"
          tabIndex={-1}
          aria-selected={k === offer.at.value}
          onMouseDown={(event) => {
            event.preventDefault();
            offer.take(one);
          }}
        >
          <b>{one.label}</b> <span>{one.doc}</span>
        </div>
      ))}
    </div>
  );
}

/** Attributes of the field above the list. */
export function completed(id: string, offer: Offer) {
  const chosen = offer.at.value;
  return {
    "aria-controls": id,
    "aria-autocomplete": "list" as const,
    ...(chosen >= 0 ? { "aria-activedescendant": optionId(id, chosen) } : {}),
  };
}

const optionId = (id: string, k: number): string => `${id}-${k}`;
