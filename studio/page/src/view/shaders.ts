// Programs of the graphics card. Light is worked out at corners and colours are not converted, since pictures must come
// quickly without a graphics card as well.

const SECTION_VARYING = /* glsl */ `
#ifdef SECTION
varying float vHeight;
#endif
`

const SECTION_CUT = /* glsl */ `
#ifdef SECTION
if (vHeight > uSection) discard;
#endif
`

const LIT = /* glsl */ `
uniform vec3 uSkyLight;
uniform vec3 uBounceLight;
uniform vec3 uSunLight;
vec3 lightOf(float up, float sun) {
  return mix(uBounceLight, uSkyLight, up * 0.5 + 0.5) + uSunLight * max(sun, 0.0);
}
`

const FOG = /* glsl */ `
uniform vec3 uFogColour;
uniform vec2 uFogRange;
vec3 fogged(vec3 colour, float depth) {
  return mix(colour, uFogColour, clamp((depth - uFogRange.x) / (uFogRange.y - uFogRange.x), 0.0, 1.0) * 0.85);
}
`

export const TERRAIN_VERTEX = /* glsl */ `
${LIT}
${FOG}
${SECTION_VARYING}
uniform vec3 uLow;
uniform vec3 uHigh;
uniform vec3 uCliff;
uniform vec3 uCeiling;
uniform vec3 uRoof;
uniform vec3 uWall;
uniform vec2 uHeights;
attribute vec4 tone;
varying vec3 vColour;
void main() {
  float up = tone.x * 2.0 - 1.0;
  float height = clamp((position.y - uHeights.x) / uHeights.y, 0.0, 1.0);
  vec3 grown = mix(uCliff, mix(uLow, uHigh, height), smoothstep(0.6, 0.76, up));
  grown = mix(grown, uCeiling, smoothstep(-0.1, -0.5, up));
  vec3 built = mix(uWall, uRoof, step(0.5, up));
  vec3 colour = mix(grown, built, tone.y) * lightOf(up, tone.z * 2.0 - 1.0);
  colour *= 1.0 + clamp((tone.w - 0.5) * 2.4, -0.35, 0.18);
  vec4 seen = modelViewMatrix * vec4(position, 1.0);
  vColour = fogged(colour, -seen.z);
#ifdef SECTION
  vHeight = position.y;
#endif
  gl_Position = projectionMatrix * seen;
}
`

export const TERRAIN_FRAGMENT = /* glsl */ `
${SECTION_VARYING}
uniform float uSection;
uniform vec3 uCut;
varying vec3 vColour;
void main() {
  ${SECTION_CUT}
#ifdef SECTION
  gl_FragColor = vec4(gl_FrontFacing ? vColour : uCut, 1.0);
#else
  gl_FragColor = vec4(vColour, 1.0);
#endif
}
`

export const SOLID_VERTEX = /* glsl */ `
${LIT}
${FOG}
${SECTION_VARYING}
uniform vec3 uSun;
uniform float uGlow;
attribute vec3 tint;
varying vec3 vColour;
void main() {
  vec4 at = modelMatrix * vec4(position, 1.0);
  vec3 direction = normalize(mat3(modelMatrix) * normal);
  vec3 colour = tint * mix(lightOf(direction.y, dot(direction, uSun)), vec3(1.0), uGlow);
  vec4 seen = viewMatrix * at;
  vColour = fogged(colour, -seen.z);
#ifdef SECTION
  vHeight = at.y;
#endif
  gl_Position = projectionMatrix * seen;
}
`

/** Many of one shape in one draw call. No instances: without a graphics card each instance costs as much as a call. */
export const NPC_VERTEX = /* glsl */ `
${LIT}
${FOG}
uniform vec3 uSun;
uniform float uGlow;
uniform sampler2D uPoses;
uniform vec3 uStates[3];
attribute float who;
attribute vec3 tint;
varying vec3 vColour;
void main() {
  vec4 place = texelFetch(uPoses, ivec2(0, int(who)), 0);
  vec4 pose = texelFetch(uPoses, ivec2(1, int(who)), 0);
  vec3 at = position;
  vec3 direction = normal;
  if (pose.z > 0.5) {
    at = vec3(at.x, 0.4 - at.z, at.y - 0.9);
    direction = vec3(direction.x, -direction.z, direction.y);
  }
  mat3 turn = mat3(pose.y, 0.0, -pose.x, 0.0, 1.0, 0.0, pose.x, 0.0, pose.y);
  at = turn * at * place.w + place.xyz;
  direction = turn * direction;
  vec3 colour = tint * uStates[int(pose.w)];
  colour *= mix(lightOf(direction.y, dot(direction, uSun)), vec3(1.0), uGlow);
  vec4 seen = viewMatrix * vec4(at, 1.0);
  vColour = fogged(colour, -seen.z);
  gl_Position = projectionMatrix * seen;
}
`

/** NPCs above the section are filtered out beforehand. */
export const NPC_FRAGMENT = /* glsl */ `
uniform float uOpacity;
varying vec3 vColour;
void main() {
  gl_FragColor = vec4(vColour, uOpacity);
}
`

export const SOLID_FRAGMENT = /* glsl */ `
${SECTION_VARYING}
uniform float uSection;
uniform float uOpacity;
varying vec3 vColour;
void main() {
  ${SECTION_CUT}
  gl_FragColor = vec4(vColour, uOpacity);
}
`

/** Nearer to the eye by a little, so that what lies on the ground does not sink into it. */
const RAISED = /* glsl */ `
vec4 raised(vec4 seen) {
  float away = length(seen.xyz);
  seen.xyz *= 1.0 - min(0.25, (0.15 + 0.004 * away) / max(away, 0.01));
  return seen;
}
`

/** Flat colours that are laid on the ground. */
export const LAID_VERTEX = /* glsl */ `
${SECTION_VARYING}
${RAISED}
attribute vec3 tint;
varying vec4 vColour;
void main() {
  vColour = vec4(tint, 1.0);
#ifdef SECTION
  vHeight = position.y;
#endif
  gl_Position = projectionMatrix * raised(viewMatrix * vec4(position, 1.0));
}
`

export const LINE_VERTEX = /* glsl */ `
${SECTION_VARYING}
${RAISED}
uniform vec2 uHalf;
uniform float uRatio;
uniform float uNear;
uniform float uThin;
#ifdef SOFT
uniform vec2 uSoftRange;
#endif
attribute vec2 corner;
attribute vec3 iStart;
attribute vec3 iEnd;
attribute vec4 iColour;
attribute vec3 iStyle;
varying vec4 vColour;
varying float vSide;
varying float vCore;
#ifdef DASHED
varying vec2 vDash;
#endif
void main() {
  vec4 a = raised(viewMatrix * vec4(iStart, 1.0));
  vec4 b = raised(viewMatrix * vec4(iEnd, 1.0));
  float near = -uNear;
  vColour = iColour;
  if (a.z > near && b.z > near) {
    gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
    return;
  }
  if (a.z > near) a = mix(a, b, (a.z - near) / (a.z - b.z));
  if (b.z > near) b = mix(b, a, (b.z - near) / (b.z - a.z));
#ifdef SOFT
  // Fades out with the distance, so that many lines seen from afar are no haze.
  vColour.a *= 1.0 - smoothstep(uSoftRange.x, uSoftRange.y, -mix(a.z, b.z, corner.x));
#endif
  vec4 from = projectionMatrix * a;
  vec4 to = projectionMatrix * b;
  vec2 way = to.xy / to.w * uHalf - from.xy / from.w * uHalf;
  float size = length(way);
  way = size > 0.001 ? way / size : vec2(1.0, 0.0);
  float core = iStyle.x * 0.5 * uRatio * uThin;
  float reach = core + uRatio;
  vSide = corner.y * reach;
  vCore = core;
  vec4 at = corner.x < 0.5 ? from : to;
  vec2 shift = vec2(-way.y, way.x) * corner.y * reach + way * (corner.x * 2.0 - 1.0) * core * 0.5;
  at.xy += shift / uHalf * at.w;
#ifdef DASHED
  vDash = vec2(iStyle.z + corner.x * length(iEnd - iStart), iStyle.y);
#endif
#ifdef SECTION
  vHeight = mix(iStart.y, iEnd.y, corner.x);
#endif
  gl_Position = at;
}
`

export const LINE_FRAGMENT = /* glsl */ `
${SECTION_VARYING}
uniform float uSection;
uniform float uOpacity;
uniform vec3 uOutline;
varying vec4 vColour;
varying float vSide;
varying float vCore;
#ifdef DASHED
varying vec2 vDash;
#endif
void main() {
  ${SECTION_CUT}
#ifdef DASHED
  if (vDash.y > 0.0 && fract(vDash.x / vDash.y) > 0.6) discard;
#endif
  float beyond = clamp(abs(vSide) - vCore + 0.5, 0.0, 1.0);
  float alpha = vColour.a * uOpacity;
#ifdef SOFT
  gl_FragColor = vec4(vColour.rgb, alpha * (1.0 - beyond));
#else
  gl_FragColor = vec4(mix(vColour.rgb, uOutline, beyond), alpha * (1.0 - beyond * 0.5));
#endif
}
`

export const SPRITE_VERTEX = /* glsl */ `
${SECTION_VARYING}
${RAISED}
uniform float uRatio;
uniform float uScale;
attribute vec4 iColour;
attribute vec4 iStyle;
varying vec4 vColour;
varying float vPixels;
varying float vShape;
void main() {
  vec4 seen = raised(viewMatrix * vec4(position, 1.0));
  gl_Position = projectionMatrix * seen;
  vPixels = clamp(iStyle.x * uScale / gl_Position.w, iStyle.y, iStyle.z) * uRatio + 2.0;
  gl_PointSize = vPixels;
  vColour = iColour;
  vShape = iStyle.w;
#ifdef SECTION
  vHeight = position.y - 0.5;
#endif
}
`

export const SPRITE_FRAGMENT = /* glsl */ `
${SECTION_VARYING}
uniform float uSection;
uniform float uOpacity;
uniform float uRatio;
uniform vec3 uOutline;
varying vec4 vColour;
varying float vPixels;
varying float vShape;
void main() {
  ${SECTION_CUT}
  vec2 at = (gl_PointCoord - 0.5) * vPixels;
  float radius = vPixels * 0.5 - 1.0;
  float inside;
  if (vShape < 0.5) {
    inside = radius - length(at);
  } else if (vShape < 1.5) {
    float thick = max(1.2 * uRatio, radius * 0.16);
    inside = thick - abs(length(at) - radius + thick);
  } else if (vShape < 2.5) {
    vec2 turned = abs(vec2(at.x + at.y, at.x - at.y)) * 0.7071;
    inside = min(radius * 0.3 - min(turned.x, turned.y), radius - max(turned.x, turned.y));
  } else {
    inside = (radius - abs(at.x) - abs(at.y)) * 0.7071;
  }
  if (inside < -0.5) discard;
  float edge = vShape < 0.5 || vShape > 1.5 ? clamp(uRatio * 1.4 - inside, 0.0, 1.0) : 0.0;
  gl_FragColor = vec4(mix(vColour.rgb, uOutline, edge * 0.85), vColour.a * uOpacity * clamp(inside + 0.5, 0.0, 1.0));
}
`

export const ARROW_VERTEX = /* glsl */ `
${SECTION_VARYING}
${RAISED}
uniform vec2 uHalf;
uniform float uRatio;
uniform float uScale;
uniform float uNear;
attribute vec2 corner;
attribute vec3 iStart;
attribute vec3 iEnd;
attribute vec4 iColour;
varying vec4 vColour;
void main() {
  vColour = iColour;
  vec4 a = raised(viewMatrix * vec4(iStart, 1.0));
  vec4 b = raised(viewMatrix * vec4(mix(iStart, iEnd, min(1.0, 0.5 / max(0.01, distance(iStart, iEnd)))), 1.0));
  vec4 from = projectionMatrix * a;
  vec4 to = projectionMatrix * b;
  float size = min(0.55 * uScale / from.w, 9.0);
  if (a.z > -uNear || b.z > -uNear || size < 2.2) {
    gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
    return;
  }
  vec2 way = (to.xy / to.w - from.xy / from.w) * uHalf;
  way /= max(length(way), 0.0001);
  vec2 shift = (way * corner.y + vec2(-way.y, way.x) * corner.x) * size * uRatio;
  from.xy += shift / uHalf * from.w;
#ifdef SECTION
  vHeight = iStart.y;
#endif
  gl_Position = from;
}
`

export const PLAIN_FRAGMENT = /* glsl */ `
${SECTION_VARYING}
uniform float uSection;
uniform float uOpacity;
varying vec4 vColour;
void main() {
  ${SECTION_CUT}
  gl_FragColor = vec4(vColour.rgb, vColour.a * uOpacity);
}
`

export const TRAIL_VERTEX = /* glsl */ `
${SECTION_VARYING}
uniform float uNow;
uniform float uLasting;
attribute float born;
attribute vec3 tint;
varying vec4 vColour;
void main() {
  float age = (uNow - born) / uLasting;
  vColour = vec4(tint, born < 0.0 ? 0.0 : clamp(1.0 - age, 0.0, 1.0) * 0.8);
  bool gone = age > 1.0 || born < 0.0;
  gl_Position = gone ? vec4(2.0, 2.0, 2.0, 1.0) : projectionMatrix * viewMatrix * vec4(position, 1.0);
#ifdef SECTION
  vHeight = position.y;
#endif
}
`
