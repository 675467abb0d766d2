// Files beside the page that show a large photograph at full size.

const KEPT = 96; // tiles in memory

export class Tiles {
  /** side: of the data. picture: the photograph as the page holds it. loaded: called when a tile has come. */
  constructor(side, picture, loaded) {
    Object.assign(this, { side, loaded });
    this.coarse = picture.naturalWidth / side.width;
    this.images = new Map(); // by name, the one used last at the end
    this.missing = false; // the files are not beside the page
  }

  /** Draws what is loaded of a box of the photograph, and asks for the rest. scale: device px per px of the photograph,
   * which are the units of the context. */
  draw(context, [x0, y0, x1, y1], scale) {
    if (scale <= this.coarse || this.missing) return;
    const { width, height, tiles } = this.side;
    const level = Math.max(0, Math.min(tiles.levels - 1, Math.floor(-Math.log2(scale))));
    const span = tiles.side * 2 ** level;
    const range = (low, high, length) => [Math.floor(Math.max(0, low) / span), Math.floor((Math.min(length, high) - 1e-6) / span)];
    const [[i0, i1], [j0, j1]] = [range(x0, x1, width), range(y0, y1, height)];
    for (let j = j0; j <= j1; j++) {
      for (let i = i0; i <= i1; i++) {
        const image = this.image(`${level}-${i}-${j}.jpg`);
        if (!image.naturalWidth) continue;
        const [x, y] = [i * span, j * span];
        context.drawImage(image, x, y, Math.min(span, width - x), Math.min(span, height - y));
      }
    }
  }

  image(name) {
    const image = this.images.get(name) ?? this.request(name);
    this.images.delete(name);
    this.images.set(name, image);
    if (this.images.size > KEPT) this.images.delete(this.images.keys().next().value);
    return image;
  }

  request(name) {
    const image = new Image();
    image.onload = () => this.loaded();
    image.onerror = () => {
      this.missing = true;
      this.loaded();
    };
    image.src = `${this.side.tiles.folder}/${this.side.name}-${name}`;
    return image;
  }
}
