/** The rows of a table, over the page: opened from its line among the values. */
import { signal } from "@preact/signals";
import { mountRows } from "../panels/rows";
import { Dialog } from "../ui/dialog";
import { Mounted } from "../ui/panel-host";
import type { App } from "./app-state";

/** The table that is open: name and title of its channel. */
export const openTable = signal<{ readonly name: string; readonly title: string } | undefined>(undefined);

export function RowsDialog({ app }: { readonly app: App }) {
  const open = openTable.value;
  if (!open) return null;
  return (
    <Dialog title={open.title} wide onClose={() => (openTable.value = undefined)}>
      <Mounted class="rowbox" label={open.title} scrolls mount={(host) => mountRows(host, app, open.name)} />
    </Dialog>
  );
}
