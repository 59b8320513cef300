// The picture that the part was read from, to scale in the work plane, under all that is drawn.
function layPhoto({ address, corners: around }) {
  const image = new Image();
  image.addEventListener("load", () => {
    const sheet = document.createElement("canvas");
    [sheet.width, sheet.height] = [image.width, image.height];
    const pen = sheet.getContext("2d");
    pen.drawImage(image, 0, 0);
    const pixels = pen.getImageData(0, 0, image.width, image.height).data;
    const texture = new THREE.DataTexture(new Uint8Array(pixels.buffer), image.width, image.height);
    // Linear between pixels, and between sizes: 1006 and 1008 are the numbers of WebGL's wrapper for that.
    Object.assign(texture, { colorSpace: "srgb", magFilter: 1006, minFilter: 1008, generateMipmaps: true, needsUpdate: true });
    const geometry = new THREE.BufferGeometry();
    const [a, b, c, d] = around;
    geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array([a, b, c, d].flat()), 3));
    geometry.setAttribute("uv", new THREE.BufferAttribute(new Float32Array([0, 0, 1, 0, 1, 1, 0, 1]), 2));
    geometry.setIndex([0, 1, 2, 0, 2, 3]);
    const mesh = new THREE.Mesh(geometry, new THREE.MeshBasicMaterial({
      map: texture, side: THREE.DoubleSide, transparent: true, depthWrite: false,
      polygonOffset: true, polygonOffsetFactor: 3, polygonOffsetUnits: 3,
    }));
    mesh.name = "photo";
    put("photo", mesh, -3);
    showLayers();
    if (renderer) paint();
  });
  image.src = address;
}
if (data.photo) layPhoto(data.photo);
