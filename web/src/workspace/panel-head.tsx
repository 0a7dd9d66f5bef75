/** The heading of a panel. */
import type { ComponentChildren, RefObject } from "preact";
import type { PanelDefinition } from "../panels/registry";
import { TEXT } from "../texts/workspace";
import type { WorkspaceSession } from "./session";
import { TileGrip } from "./tile-grip";

interface Props {
  readonly panel: PanelDefinition;
  readonly session: WorkspaceSession;
  /** The panels that apply, in their default order. */
  readonly all: readonly PanelDefinition[];
  readonly caption: RefObject<HTMLSpanElement | null>;
  readonly children?: ComponentChildren;
}

export function PanelHead({ panel, session, all, caption, children }: Props) {
  return (
    <div class="head">
      <TileGrip session={session} panel={panel} all={all} />
      <h2 title={TEXT.doubleClickToMaximise}>{panel.title}</h2>
      <span ref={caption}>{panel.note}</span>
      {children}
    </div>
  );
}
