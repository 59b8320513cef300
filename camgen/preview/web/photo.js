// The picture that the part was read from, to scale in the work plane, under all that is drawn.
const PHOTOS = program(`
  layout(location = 0) in vec3 point;
  layout(location = 1) in vec3 spot;
  uniform mat4 clip;
  out vec2 vSpot;
  void main() {
    vSpot = spot.xy;
    gl_Position = clip * vec4(point, 1.0);
  }`, `
  in vec2 vSpot;
  uniform sampler2D picture;
  out vec4 seen;
  void main() {
    vec4 own = texture(picture, vSpot);
    seen = vec4(mix(1.055 * pow(own.rgb, vec3(1.0 / 2.4)) - 0.055, own.rgb * 12.92, vec3(lessThanEqual(own.rgb, vec3(0.0031308)))), own.a);
  }`);

function layPhoto({ address, corners: around }) {
  const image = new Image();
  image.addEventListener("load", () => {
    const points = new Float32Array(around.flat());
    const index = new Uint32Array([0, 1, 2, 0, 2, 3]);
    const draw = drawing(shape({ points, normals: new Float32Array([0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0]), index }), PHOTOS, {
      picture: { value: pictureTexture(image) },
    }, { clear: true, depthWrite: false, offset: [3, 3] });
    put("photo", thing({ name: "photo", draw }), -3);
    showLayers();
    redraw();
  });
  image.src = address;
}
if (data.photo) layPhoto(data.photo);
