/** The way of a recording to the store: a few words in the list, and the reason in its details. Nothing without a store. */
import { useEffect } from "preact/hooks";
import type { RecordingProps } from "../../../pages/recordings/library";
import type { App } from "../../../page/context";
import { dateWords } from "../../../recordings/library-filter";
import { TEXT as RECORDINGS } from "../../../texts/recordings";
import { Hint } from "../../../ui/controls/card";
import type { RecordingUpload } from "../../../wire/routes";
import { uploadsOf } from "./state";
import { TEXT } from "./texts";
import "./uploads.css";

function useUpload(app: App, id: string): RecordingUpload | undefined {
  useEffect(() => uploadsOf(app).follow(), [app]);
  return uploadsOf(app).known.value.get(id);
}

const words = ({ state, progress }: RecordingUpload): string =>
  state === "uploading" ? TEXT.uploading(Math.round(100 * progress)) : TEXT.state[state];

/** State in the list. */
export function UploadMark({ app, info }: RecordingProps) {
  const upload = useUpload(app, info.id);
  if (upload === undefined) return null;
  return (
    <span class="upload-mark" title={upload.reason}>
      {words(upload)} ·{" "}
    </span>
  );
}

/** State, time and reason in the details. */
export function UploadFacts({ app, info }: RecordingProps) {
  const upload = useUpload(app, info.id);
  if (upload === undefined) return null;
  const since = upload.stored_at === null ? "" : RECORDINGS.timeUtc(dateWords(upload.stored_at, true));
  return (
    <section class="upload-facts">
      <h3>{TEXT.store}</h3>
      <p>
        {words(upload)}
        {since !== "" && <span class="mid"> · {since}</span>}
      </p>
      {upload.reason !== "" && <Hint text={upload.reason} />}
    </section>
  );
}
