/** A panel whose code is loaded when it is first shown; until then its place is empty. */
import type { Panel } from "./dom";

/** The panel that `load` mounts; disposed of before that, it is never mounted. */
export function latePanel(load: () => Promise<() => Panel>): Panel {
  let [panel, isGone] = [undefined as Panel | undefined, false];
  void load().then(
    (mount) => {
      if (!isGone) panel = mount();
    },
    (error: unknown) => reportError(error),
  );
  return {
    update: (now) => panel?.update(now),
    dispose() {
      isGone = true;
      panel?.dispose();
    },
  };
}
