/** The way of a recording to the store: a few words in the list, and the reason in its details. Nothing without a store. */
import { useEffect } from "preact/hooks";
import type { RecordingProps } from "../../../pages/recordings/library";
import type { App } from "../../../page/context";
import { dateWords } from "../../../recordings/library-filter";
import { TEXT as RECORDINGS } from "../../../texts/recordings";
import { Hint } from "../../../ui/controls/card";
import type { RecordingUpload } from "../../../wire/routes";
import { TEXT } from "./texts";
import { effect, signal } from "@preact/signals";
import { perApp } from "../../../page/app-state";
import { request } from "../../../requests/http";
import "./uploads.css";

/** Interval of asking while one is under way, ms. */
const EVERY_MS = 3000;

export const uploadsOf = perApp(({ store }) => {
  const known = signal<ReadonlyMap<string, RecordingUpload>>(new Map());
  let [asked, followers] = [0, 0];
  let timer: ReturnType<typeof setTimeout> | undefined;
  let end = (): void => undefined;

  const load = async (mine: number): Promise<void> => {
    const outcome = await request("GET /api/uploads");
    if (mine !== asked) return;
    if (outcome.ok) known.value = new Map(outcome.value.recordings.map((one) => [one.id, one]));
    if ([...known.peek().values()].some(({ state }) => state === "waiting" || state === "uploading"))
      timer = setTimeout(() => void load(mine), EVERY_MS);
  };
  const start = (): (() => void) =>
    effect(() => {
      void store.library.value;
      void store.recorder.value?.running;
      clearTimeout(timer);
      if (store.connection.value === "open") void load(++asked);
    });

  return {
    /** By recording; empty without a store. */
    known,
    /** Each part of the page that shows one follows them; the first starts asking. */
    follow(): () => void {
      if (followers++ === 0) end = start();
      return () => {
        if (--followers > 0) return;
        end();
        asked += 1;
        clearTimeout(timer);
      };
    },
  };
});

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
