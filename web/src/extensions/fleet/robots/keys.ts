/** The keys of the fleet page, for the list of keys. */
import type { KeyGroup } from "../../../page/keys";
import { COMMON } from "../../../texts/common";
import { TEXT } from "./texts";

export const FLEET_KEYS: readonly KeyGroup[] = [
  {
    title: TEXT.robots,
    lines: [
      { keys: ["↑", "↓"], what: TEXT.keyMove },
      { keys: ["Page ↑", "Page ↓", "Home", "End"], what: TEXT.keyFar },
      { keys: ["Enter"], what: TEXT.keyOpen },
      { keys: ["←", "→"], what: TEXT.keyExpand },
      { keys: ["S"], what: TEXT.keySort },
    ],
  },
  {
    title: COMMON.keysOfPages,
    lines: [
      { keys: ["G F", "G R"], what: TEXT.keyPages },
      { keys: ["/"], what: TEXT.search },
      { keys: ["?"], what: COMMON.keyboard },
      { keys: ["Esc"], what: TEXT.closeDetails },
    ],
  },
];
