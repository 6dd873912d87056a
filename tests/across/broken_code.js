[...document.querySelectorAll('.docutils :is(td, th) .pre')]
  .filter(word => word.getClientRects().length > 1).map(word => word.textContent)
