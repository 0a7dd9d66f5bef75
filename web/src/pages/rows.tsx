/** The rows of a table, over the page: opened from its line among the values. */
import { mountRows } from "../panels/rows";
import { Dialog } from "../ui/controls/dialog";
import { PanelHost } from "../panels/panel-host";
import type { Deps } from "../page/context";
import type { App } from "../page/context";

export function RowsDialog({ app, deps }: { readonly app: App; readonly deps: Deps }) {
  const open = app.openTable.value;
  if (!open) return null;
  return (
    <Dialog title={open.title} wide onClose={() => (app.openTable.value = undefined)}>
      <PanelHost class="rows-box" label={open.title} scrolls mount={(host) => mountRows(host, deps, open.name)} />
    </Dialog>
  );
}
