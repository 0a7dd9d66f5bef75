/** The rows of a table, over the page: opened from its line among the values. */
import { mountRows } from "../panels/rows";
import { Dialog } from "../ui/dialog";
import { PanelHost } from "../ui/panel-host";
import { type App, openTable } from "./app-state";

export function RowsDialog({ app }: { readonly app: App }) {
  const open = openTable.value;
  if (!open) return null;
  return (
    <Dialog title={open.title} wide onClose={() => (openTable.value = undefined)}>
      <PanelHost class="rows-box" label={open.title} scrolls mount={(host) => mountRows(host, app, open.name)} />
    </Dialog>
  );
}
