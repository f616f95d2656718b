// Names what the theme leaves without a name: screen readers list dialogues and landmarks by their names.
document.querySelector(".md-search").setAttribute("aria-label", "Search");
for (const nav of document.querySelectorAll(".md-nav[aria-labelledby]")) {
  nav.removeAttribute("aria-labelledby");
  nav.setAttribute("aria-label", nav.querySelector(".md-nav__title").textContent.trim());
}
// The theme makes each copy button a landmark, and it does so when its block of code comes into view.
new MutationObserver(() => {
  for (const nav of document.querySelectorAll("nav.md-code__nav:not([role])")) nav.setAttribute("role", "none");
}).observe(document.body, { childList: true, subtree: true });
