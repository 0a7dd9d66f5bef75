/** The page of another program. */
export function Frame({ address, title }: { readonly address: string; readonly title: string }) {
  return <iframe src={address} title={title} allow="fullscreen" />;
}
