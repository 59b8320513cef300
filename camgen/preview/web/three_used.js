// What the page uses of three.js. To make three.min.js anew: see docs/preview.md.
export {
  AlwaysStencilFunc, BoxGeometry, BufferAttribute, BufferGeometry, Color, ConeGeometry, CylinderGeometry, DataTexture,
  DirectionalLight, DoubleSide, EdgesGeometry, FloatType, Group, HemisphereLight, InvertStencilOp, KeepStencilOp,
  LineBasicMaterial, LineSegments, Matrix4, Mesh, MeshBasicMaterial, MeshLambertMaterial, NotEqualStencilFunc,
  OrthographicCamera, PlaneGeometry, Quaternion, RGBAFormat, Scene, ShaderMaterial, Vector2, Vector3, WebGLRenderer,
} from "three";
