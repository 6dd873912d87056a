(async () => {
  document.querySelectorAll('details').forEach(one => one.open = true);
  await Promise.all([...document.images].map(picture => picture.decode()));
  return [...document.querySelectorAll('article img')].map(picture => {
    let column = picture.parentElement;
    while (getComputedStyle(column).display === 'inline') column = column.parentElement;
    const style = getComputedStyle(column);
    const available = column.clientWidth - parseFloat(style.paddingLeft) - parseFloat(style.paddingRight);
    const {width, height} = picture.getBoundingClientRect();
    const inCard = picture.closest('.card, .scene') !== null;
    return [picture.getAttribute('src'), picture.naturalWidth, picture.naturalHeight, available, width, height, inCard];
  });
})()
