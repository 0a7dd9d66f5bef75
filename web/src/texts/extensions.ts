/** Texts about extensions of other packages. */

export const extensionFailed = (title: string, why: string) => ({
  message: `${title} cannot be shown on this page: ${why}.`,
  hint: "Everything else works. Install another version of its package, or remove it.",
});
