/** Going to a moment: a time, or the next and previous place of a kind. */
import { registerExtension } from "../../extension/extension";
import type { ExtensionPress } from "../../page/keys";
import { COMMON } from "../../texts/common";
import { GoTo } from "./go-to";
import { openGoTo, stepPlace } from "./state";
import { TEXT } from "./texts";

const viewOf = ({ app, recording }: ExtensionPress) => (recording?.replay ?? app).viewState;

registerExtension({
  name: "moments",
  views: [{ slot: "underPlots", order: 10, View: (properties) => <GoTo deps={properties} /> }],
  keys: [
    { key: "j", group: COMMON.keysOfTime, before: "L", what: TEXT.keyGoTo, press: (at) => openGoTo(viewOf(at)) },
    {
      key: "n",
      group: COMMON.keysOfTime,
      before: "L",
      what: TEXT.keyPlace,
      withShift: true,
      press: (at) => stepPlace(viewOf(at), !at.isShifted),
    },
  ],
});
