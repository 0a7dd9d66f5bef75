/** The way of a recording to the store: a few words in the list, and the reason in its details. Nothing without a store. */
import type { RecordingUpload } from "../../wire/routes";
import { Message } from "../../ui/message";
import { dateWords } from "../../recordings/library-filter";
import { TEXT } from "../../texts/recordings";

const words = ({ state, progress }: RecordingUpload): string =>
  state === "uploading" ? TEXT.uploadingShare(Math.round(100 * progress)) : TEXT.uploadState[state];

/** State in the list. */
export function UploadMark({ upload }: { readonly upload: RecordingUpload | undefined }) {
  if (upload === undefined) return null;
  return (
    <span class="upload-mark" title={upload.reason}>
      {words(upload)} ·{" "}
    </span>
  );
}

/** State, time and reason in the details. */
export function UploadFacts({ upload }: { readonly upload: RecordingUpload | undefined }) {
  if (upload === undefined) return null;
  const since = upload.stored_at === null ? "" : TEXT.timeUtc(dateWords(upload.stored_at, true));
  return (
    <section class="upload-facts">
      <h3>{TEXT.store}</h3>
      <p>
        {words(upload)}
        {since !== "" && <span class="mid"> · {since}</span>}
      </p>
      {upload.reason !== "" && (
        <p class="hint">
          <Message text={upload.reason} />
        </p>
      )}
    </section>
  );
}
