/** Texts of uploads to the store. */
import type { Value } from "../../../wire/texts";

export const TEXT = {
  store: "Store",
  state: {
    waiting: "Waiting for upload",
    uploading: "Uploading",
    stored: "In the store",
    refused: "Not uploaded",
  },
  uploading: (percent: Value) => `Uploading ${percent} %`,
};
