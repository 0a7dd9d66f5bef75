/** The heading of a panel. */
import type { ComponentChildren, RefObject } from "preact";
import type { PanelDefinition } from "../panels/registry";
import { TEXT } from "../texts/workspace";

interface Props {
  readonly panel: PanelDefinition;
  readonly caption: RefObject<HTMLSpanElement | null>;
  readonly children?: ComponentChildren;
}

export function PanelHead({ panel, caption, children }: Props) {
  return (
    <div class="head">
      <h2 title={TEXT.doubleClickToMaximise}>{panel.title}</h2>
      <span ref={caption}>{panel.note}</span>
      {children}
    </div>
  );
}
