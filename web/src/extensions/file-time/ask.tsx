/**
 * Tables that can be read in more than one way: one that was dropped, or is opened, is shown with its first rows and the question.
 *
 * Several dropped at once are asked about one after the other; those with the heading of the first are read as it is.
 */
import { effect } from "@preact/signals";
import { render } from "preact";
import type { App } from "../../page/context";
import { type Coming, libraryOf } from "../../pages/recordings/library-store";
import { route } from "../../page/route";
import { request } from "../../requests/http";
import { ReadingDialog } from "./reading-dialog";
import { reopen } from "./reopen";

/** Starts asking, until the returned function is called. */
export function followTables(app: App): () => void {
  const library = libraryOf(app);
  const host = document.createElement("div");
  document.body.append(host);
  const waiting: string[] = [];
  let shown: string | undefined;

  const close = (): void => {
    shown = undefined;
    render(null, host);
    void next();
  };
  const chosen = (id: string): void => {
    close();
    if (waiting.length === 0) reopen(id);
  };
  const next = async (): Promise<void> => {
    const id = shown === undefined ? waiting.shift() : undefined;
    if (id === undefined) return;
    shown = id;
    const state = await request("GET /api/recordings/{recording}/reading", { path: { recording: id } });
    if (shown !== id) return;
    if (!state.ok || state.value.about === "") return close();
    render(
      <ReadingDialog
        recording={id}
        title={library.all.peek()?.find((one) => one.id === id)?.file ?? id}
        state={state.value}
        onClose={close}
        onChosen={() => chosen(id)}
      />,
      host,
    );
  };
  const ask = (id: string | undefined): void => {
    if (id === undefined || id === shown || waiting.includes(id)) return;
    waiting.push(id);
    void next();
  };

  let before: readonly Coming[] = [];
  const stops = [
    effect(() => ask(route.value.page === "recordings" ? route.value.recording : undefined)),
    effect(() => {
      const now = library.coming.value;
      const isDone = before.some(({ key, problem }) => !problem && !now.some((one) => one.key === key));
      before = now;
      if (isDone) ask(library.selected.peek());
    }),
  ];
  return () => {
    for (const stop of stops) stop();
    render(null, host);
    host.remove();
  };
}
