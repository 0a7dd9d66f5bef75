/** A viewer of others, as an extension brings it (extension/extension.tsx): its page is shown in a frame beside the panels. */
import type { FunctionComponent } from "preact";
import type { ReplayController } from "../recordings/replay-controller";
import type { IconName } from "../ui/controls/icons";

declare module "../extension/extension" {
  interface Extension {
    /** Viewers that show devices or recordings in a frame. */
    readonly viewers?: readonly Viewer[];
  }
}

export interface Viewer {
  readonly id: string;
  /** The first in ascending order is opened first. */
  readonly order: number;
  readonly icon: IconName;
  /** Of its button and its frame: "3D scene". */
  readonly title: string;
  /** Where one is chosen among several: "Scene", with a hint. */
  readonly choice: string;
  readonly choiceHint: string;
  /** As an object of a sentence: "a 3D scene". */
  readonly object: string;
  /** The action that closes it: "Close the 3D scene". */
  readonly close: string;
  /** What showing all devices does. */
  readonly allHint: string;
  /** Title of its frame over a recording. */
  readonly recordingTitle?: string;
  /** Address of its page: of one device, or of all. Reads signals. */
  readonly address: (device: string | undefined) => string;
  /** Its page, of one device or of all. */
  readonly Live: FunctionComponent<{ readonly device: string | undefined }>;
  /** Its page over a recording; absent: it shows none in the frame. */
  readonly Recording?: FunctionComponent<{ readonly replay: ReplayController }>;
}
