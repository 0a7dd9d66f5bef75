/** A panel whose code is loaded when it is first shown; until then its place is empty. */
import type { Panel } from "./dom";
import { fetchCode } from "./late";

/** The panel that `load` mounts; disposed of before that, it is never mounted. */
export function latePanel(load: () => Promise<() => Panel>): Panel {
  let panel: Panel | undefined;
  const stop = fetchCode(load, (mount) => (panel = mount()));
  return {
    update: (now) => panel?.update(now),
    dispose() {
      stop();
      panel?.dispose();
    },
  };
}
