/** Corrections for a receiver: a stream of RTCM 3 that the server forwards to it. */
import { registerExtension } from "../../extension/extension";

import { late } from "../../ui/dom/late";
import { TEXT } from "./texts";

const Corrections = late(async () => (await import("./form")).CorrectionsForm);

registerExtension({
  name: "corrections",
  configurePlaces: [
    {
      name: "corrections",
      title: TEXT.corrections,
      note: TEXT.rtcm,
      applies: ({ corrections }) => corrections,
      View: Corrections,
    },
  ],
});
