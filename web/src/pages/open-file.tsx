/** A button that opens files as recordings, as a drop on the page does. */
import { useRef } from "preact/hooks";
import type { App } from "../page/context";
import { go, route } from "../page/route";
import { Button } from "../ui/controls/button";
import { TEXT } from "../texts/live";

/** Adds files to the recordings, and shows those. */
export function openFiles(app: App, files: readonly File[]): void {
  if (files.length === 0) return;
  if (route.peek().page !== "recordings" || route.peek().recording !== undefined) go("recordings");
  void import("./recordings/library-store").then(({ libraryOf }) => libraryOf(app).add(files));
}

export function OpenFile({ app, look }: { readonly app: App; readonly look: string }) {
  const chooser = useRef<HTMLInputElement>(null);
  return (
    <>
      <Button changes look={look} words={TEXT.openAFile} onClick={() => chooser.current?.click()} />
      <input
        ref={chooser}
        type="file"
        multiple
        hidden
        aria-label={TEXT.openAFile}
        onChange={({ currentTarget }) => openFiles(app, [...(currentTarget.files ?? [])])}
      />
    </>
  );
}
