// Names what the theme leaves without a name: screen readers list dialogues and landmarks by their names.
document.querySelector(".md-search").setAttribute("aria-label", "Search");
for (const nav of document.querySelectorAll(".md-nav[aria-labelledby]")) {
  nav.removeAttribute("aria-labelledby");
  nav.setAttribute("aria-label", nav.querySelector(".md-nav__title").textContent.trim());
}
// Keys reach what is wider than a phone, to move it sideways.
const wide = new ResizeObserver(entries => {
  for (const { target } of entries) target.tabIndex = target.scrollWidth > target.clientWidth ? 0 : -1;
});
// The theme makes each copy button a landmark, when its block of code comes into view, and it wraps tables late.
new MutationObserver(() => {
  for (const nav of document.querySelectorAll("nav.md-code__nav:not([role])")) nav.setAttribute("role", "none");
  for (const table of document.querySelectorAll(".md-typeset__scrollwrap:not([tabindex])")) wide.observe(table);
}).observe(document.body, { childList: true, subtree: true });
