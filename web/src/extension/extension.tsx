/**
 * Door for extensions of the page: what it has beyond its heart, each in a folder of its own.
 *
 *     extensions/NAME/index.ts(x)   registerExtension({ name: "NAME", … })
 *
 * extensions/all.ts finds the folders; nothing else names them, and a folder that is removed leaves a page without it. What is seldom
 * shown is fetched when it is first shown (ui/dom/late.tsx). Texts are in texts.ts of the folder, and its style sheets are in the layer
 * `extensions.NAME`. A view stands in a slot, in the order of its number.
 *
 * This file knows no host. What an extension may bring is declared where it is shown: `declare module` there adds to `Extension` and
 * `Slots`.
 */
import type { FunctionComponent } from "preact";
import { capabilities } from "../wire/capabilities";

/** Places for views of extensions, with the properties that a view gets there. */
// biome-ignore lint/suspicious/noEmptyInterface: hosts add to it
export interface Slots {}

type SlotView = {
  readonly [Name in keyof Slots]: {
    readonly slot: Name;
    readonly order: number;
    readonly View: FunctionComponent<Slots[Name]>;
  };
}[keyof Slots];

/** Name of a dialog: that of its extension comes first. */
export type ExtensionOverlay = `${string}/${string}`;

export interface Extension {
  /** Unique: the name of its folder. */
  readonly name: string;
  readonly views?: readonly SlotView[];
}

const extensions = new Map<string, Extension>();

/**
 * Makes an extension part of the page.
 *
 * @throws Error if its name is taken
 */
export function registerExtension(extension: Extension): void {
  const { name } = extension;
  if (extensions.has(name)) throw new Error(`two extensions have the name ${name}`);
  extensions.set(name, extension);
}

type Kinds = {
  readonly [Kind in keyof Extension]-?: NonNullable<Extension[Kind]> extends readonly unknown[] ? Kind : never;
};
type Brought<Kind extends keyof Extension> = NonNullable<Extension[Kind]> extends readonly (infer One)[] ? One : never;

/** What all extensions bring of one kind. */
export function fromExtensions<Kind extends Kinds[keyof Extension]>(kind: Kind): readonly Brought<Kind>[] {
  return [...extensions.values()].filter(isThere).flatMap((extension) => (extension[kind] ?? []) as Brought<Kind>[]);
}

/** Whether the server has its part of an extension: a smaller installation leaves some out, and an older server does not say so. */
const isThere = ({ name }: Extension): boolean => !(capabilities.value.absent ?? []).some((one) => one.name === name);

/** All that were registered, in that order. */
export const allExtensions = (): readonly Extension[] => [...extensions.values()];

interface SlotProps<Name extends keyof Slots> {
  readonly name: Name;
  readonly with: Slots[Name];
}

/** The views of a slot, in their order. */
export function Slot<Name extends keyof Slots>({ name, with: properties }: SlotProps<Name>) {
  const views = fromExtensions("views").filter(({ slot }) => slot === name);
  const inOrder = views.toSorted((a, b) => a.order - b.order);
  return (
    <>
      {inOrder.map(({ View }, index) => {
        const Shown = View as FunctionComponent<Slots[Name]>; // of this slot
        return <Shown key={index} {...properties} />;
      })}
    </>
  );
}
