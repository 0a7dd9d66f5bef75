/** What stands under the plots of Live or of a recording is told of them. */
import type { ViewState } from "../data/view-state";
import type { SampleAccess } from "../measure/sample-access";

declare module "../extension/extension" {
  interface Slots {
    /** Under the plots of Live or of an open recording. */
    readonly underPlots: UnderPlots;
  }
}

export interface UnderPlots {
  readonly viewState: ViewState;
  /** Samples of a recording; of a live device the rings of the channels hold all of them. */
  readonly samples?: SampleAccess;
  /** Id of the recording, or of the live device. */
  readonly source: () => string;
  /** Times of the places of a kind, unix s, for the selected device. */
  readonly places: (kind: "event" | "marker" | "gap") => readonly number[];
  /** Called before the view goes somewhere. */
  readonly halt?: () => void;
}
