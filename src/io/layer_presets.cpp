#include "io/layer_presets.h"

namespace raymeld {
namespace {

using enum LayerRule;

// Fits a file of plain RGB, and names that are not one renderer's own.
LayerPreset generic() {
  return {"generic",
          {
              {"color",
               kRead,
               {{"", "rgba", "RGBA", "rgb", "RGB", "beauty", "Beauty", "color", "Color", "main", "C"}}},
              {"albedo", kRead, {{"albedo", "Albedo", "ALBEDO"}}},
              {"normal", kRead, {{"normal", "Normal", "NORMAL"}}},
              {"diffuse", kRead, {{"diffuse", "Diffuse"}}},
              {"specular", kRead, {{"specular", "Specular"}}},
              {"variance", kRead, {{"variance", "Variance"}}},
          },
          {{"motion", "Motion"}, {1, 1}, {"depth", "Depth", ""}}};
}

// Blender 2.8 to 4.x shorten the pass names; later releases spell them out. X and Y of Vector lead to the
// last frame, with Y upwards. Like albedo and normal, Denoising Depth looks through mirrors.
LayerPreset cycles() {
  return {
      "cycles",
      {
          {"color", kRead, {{"Noisy Image", "Combined"}}},
          {"color", kRead, {{""}}, "there is no Combined", true},
          {"albedo", kRead, {{"Denoising Albedo"}}},
          {"albedo", kRead, {{"DiffCol", "Diffuse Color"}}, "there is no Denoising Albedo"},
          {"normal", kRead, {{"Denoising Normal"}}},
          {"normal", kRead, {{"Normal"}}, "there is no Denoising Normal"},
          {"diffuse",
           kEquation2,
           {{"DiffCol", "Diffuse Color"}, {"DiffDir", "Diffuse Direct"}, {"DiffInd", "Diffuse Indirect"}}},
          {"specular",
           kEquation2,
           {{"GlossCol", "Glossy Color"}, {"GlossDir", "Glossy Direct"}, {"GlossInd", "Glossy Indirect"}}},
      },
      {{"Vector"}, {1, -1}, {"Denoising Depth", "Depth"}}};
}

LayerPreset pbrt() {
  return {"pbrt",
          {
              {"color", kRead, {{""}}},
              {"albedo", kRead, {{"Albedo"}}},
              {"normal", kRead, {{"Ns"}}},
              {"normal", kRead, {{"N"}}, "there is no shading normal Ns"},
              {"variance", kRead, {{"Variance"}}},
          }};
}

// motionvector leads to the next frame, with Y upwards.
LayerPreset arnold() {
  return {"arnold",
          {
              {"color", kRead, {{"", "RGBA"}}},
              {"albedo", kRead, {{"diffuse_albedo"}}},
              {"albedo", kRead, {{"albedo"}}, "there is no diffuse_albedo"},
              {"normal", kRead, {{"N"}}},
              {"diffuse", kRead, {{"diffuse"}}},
              {"diffuse", kSum, {{"diffuse_direct"}, {"diffuse_indirect"}}},
              {"specular", kRead, {{"specular"}}},
              {"specular", kSum, {{"specular_direct"}, {"specular_indirect"}}},
              {"variance", kRead, {{"variance"}}},
          },
          {{"motionvector"}, {-1, 1}, {""}}};
}

LayerPreset renderman() {
  return {"renderman",
          {
              {"color", kRead, {{"Ci", ""}}},
              {"albedo", kRead, {{"albedo"}}},
              {"normal", kRead, {{"normal"}}},
              {"diffuse", kRead, {{"diffuse"}}},
              {"diffuse", kSum, {{"directDiffuse"}, {"indirectDiffuse"}}},
              {"specular", kRead, {{"specular"}}},
              {"specular", kSum, {{"directSpecular"}, {"indirectSpecular"}}},
          },
          {{"backward", "motionBack"}, {1, 1}, {""}}};
}

}  // namespace

std::span<const LayerPreset> layer_presets() {
  static const std::vector<LayerPreset> presets = {generic(), cycles(), arnold(), pbrt(), renderman()};
  return presets;
}

}  // namespace raymeld
