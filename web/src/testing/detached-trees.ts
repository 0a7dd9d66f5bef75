/**
 * Makes happy-dom build a tree in time that grows with its size.
 *
 * Preact appends children before it appends their parent. At each of these steps happy-dom goes through the whole tree below, to tell
 * each node what it belongs to (document, window, form, select …): a node is told as often as it has ancestors, which took a sixth of the
 * time of these tests. Between two trees of which none is in the document there is usually no news, and then nothing is told.
 */
import { PropertySymbol } from "happy-dom";

type Symbols = Record<symbol, unknown>;

/** What a node has from its ancestors. */
const INHERITED = [
  PropertySymbol.rootNode,
  PropertySymbol.styleNode,
  PropertySymbol.textAreaNode,
  PropertySymbol.formNode,
  PropertySymbol.selectNode,
];
const { connectedToNode, host, isConnected, ownerDocument, parentNode, window: ofWindow } = PropertySymbol;

function hasNews(node: Symbols, parent: Symbols): boolean {
  return (
    Boolean(node[isConnected] || parent[isConnected]) ||
    node[ownerDocument] !== parent[ownerDocument] ||
    node[ofWindow] !== parent[ofWindow] ||
    INHERITED.some((one) => parent[one] && parent[one] !== node[one])
  );
}

/** Each test file has a window of its own, but its nodes may have the classes of the previous one. */
const CHANGED = Symbol("changed");

export function buildDetachedTreesOnce(): void {
  const nodes = Node.prototype as unknown as Symbols;
  if (nodes[CHANGED]) return;
  nodes[CHANGED] = true;
  const tell = nodes[connectedToNode] as (this: Symbols) => void;
  nodes[connectedToNode] = function (this: Symbols): void {
    if (hasNews(this, (this[parentNode] ?? this[host]) as Symbols)) tell.call(this);
  };
}
