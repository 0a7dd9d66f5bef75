/** Uploads of recordings to the store: asked for while the library shows any, and again while one is under way. */
import { effect, signal } from "@preact/signals";
import { perApp } from "../../../page/app-state";
import { request } from "../../../requests/http";
import type { RecordingUpload } from "../../../wire/routes";

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
