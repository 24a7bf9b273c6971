#include "io/layer_map.h"

#include <OpenEXR/ImfChannelList.h>
#include <gtest/gtest.h>

#include <map>

#include "error_of.h"
#include "io/layers_from_exr.h"
#include "support.h"

namespace raymeld {
namespace {

using test::contains;
using test::TemporaryDirectory;
using Names = std::vector<std::string>;

Names operator+(Names a, const Names& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

Names rgb(const std::string& prefix) { return {prefix + ".B", prefix + ".G", prefix + ".R"}; }
Names rgba(const std::string& prefix) { return Names{prefix + ".A"} + rgb(prefix); }
Names xyz(const std::string& prefix) { return {prefix + ".X", prefix + ".Y", prefix + ".Z"}; }

ChannelTriple triple(const std::string& prefix, const std::string& channels = "RGB") {
  return {prefix + "." + channels[0], prefix + "." + channels[1], prefix + "." + channels[2]};
}

// Returns the single term of a layer that is read as it is.
ChannelTriple read_from(const LayerMap& map, const std::string& layer) {
  const auto found = map.layers.find(layer);
  if (found == map.layers.end() || found->second.rule != LayerRule::kRead || found->second.terms.size() != 1)
    return {"not", "read", ""};
  return found->second.terms[0];
}

// Returns all channels that Blender 3.4 writes for the passes that count here.
Names blender_old(const std::string& layer, const std::string& view = "") {
  const std::string end = view.empty() ? "" : "." + view;
  Names names = rgba(layer + ".Combined" + end) + Names{layer + ".Denoising Depth" + end + ".Z"} +
                xyz(layer + ".Denoising Normal" + end) + rgb(layer + ".Denoising Albedo" + end) +
                Names{layer + ".Depth" + end + ".Z"} + xyz(layer + ".Normal" + end);
  for (const std::string pass :
       {"DiffCol", "DiffDir", "DiffInd", "GlossCol", "GlossDir", "GlossInd", "TransCol", "Emit", "Env"})
    names = names + rgb(layer + "." + pass + end);
  return names;
}

TEST(LayerMap, CyclesWithOldNames) {
  const LayerMap map = map_layers(blender_old("ViewLayer"));
  EXPECT_EQ(map.preset, "cycles");
  EXPECT_EQ(map.view_layer, "ViewLayer");
  EXPECT_EQ(read_from(map, "color"), triple("ViewLayer.Combined"));
  EXPECT_EQ(read_from(map, "albedo"), triple("ViewLayer.Denoising Albedo"));
  EXPECT_EQ(read_from(map, "normal"), triple("ViewLayer.Denoising Normal", "XYZ"));
  EXPECT_EQ(map.alpha, "ViewLayer.Combined.A");
  const LayerSource& diffuse = map.layers.at("diffuse");
  EXPECT_EQ(diffuse.rule, LayerRule::kEquation2);
  EXPECT_EQ(diffuse.terms, (std::vector{triple("ViewLayer.DiffCol"), triple("ViewLayer.DiffDir"),
                                        triple("ViewLayer.DiffInd")}));
  const LayerSource& specular = map.layers.at("specular");
  EXPECT_EQ(specular.rule, LayerRule::kEquation2);
  EXPECT_EQ(specular.terms, (std::vector{triple("ViewLayer.GlossCol"), triple("ViewLayer.GlossDir"),
                                         triple("ViewLayer.GlossInd")}));
  const LayerSource& variance = map.layers.at("variance");
  EXPECT_EQ(variance.rule, LayerRule::kVariance);
  EXPECT_EQ(variance.terms, std::vector{triple("ViewLayer.Combined")});
}

TEST(LayerMap, CyclesWithSpelledOutNames) {
  Names names =
      rgba("ViewLayer.Combined") + rgb("ViewLayer.Denoising Albedo") + xyz("ViewLayer.Denoising Normal");
  for (const std::string pass : {"Diffuse Color", "Diffuse Direct", "Diffuse Indirect", "Glossy Color",
                                 "Glossy Direct", "Glossy Indirect", "Emission"})
    names = names + rgb("ViewLayer." + pass);
  const LayerMap map = map_layers(names);
  EXPECT_EQ(map.preset, "cycles");
  EXPECT_EQ(map.layers.at("diffuse").terms,
            (std::vector{triple("ViewLayer.Diffuse Color"), triple("ViewLayer.Diffuse Direct"),
                         triple("ViewLayer.Diffuse Indirect")}));
  EXPECT_EQ(map.layers.at("specular").terms[2], triple("ViewLayer.Glossy Indirect"));
}

TEST(LayerMap, NoisyImageComesBeforeCombined) {
  const LayerMap map = map_layers(blender_old("L") + rgb("L.Noisy Image"));
  EXPECT_EQ(read_from(map, "color"), triple("L.Noisy Image"));
  EXPECT_EQ(map.alpha, "L.Combined.A");
  EXPECT_EQ(map.layers.at("variance").terms, std::vector{triple("L.Noisy Image")});
}

TEST(LayerMap, LayerNamesMayHoldDotsAndSpaces) {
  const LayerMap map = map_layers(blender_old("My View.Layer.001"));
  EXPECT_EQ(map.view_layer, "My View.Layer.001");
  EXPECT_EQ(read_from(map, "color"), triple("My View.Layer.001.Combined"));
}

TEST(LayerMap, PassesWithoutAViewLayer) {
  const LayerMap map = map_layers(rgba("Combined") + rgb("Denoising Albedo") + xyz("Denoising Normal"));
  EXPECT_EQ(map.view_layer, "");
  EXPECT_EQ(read_from(map, "albedo"), triple("Denoising Albedo"));
}

TEST(LayerMap, Views) {
  const Names names = blender_old("ViewLayer", "left") + blender_old("ViewLayer", "right");
  const LayerMap first = map_layers(names);
  EXPECT_EQ(first.view, "left");
  EXPECT_EQ(first.view_layer, "ViewLayer");
  EXPECT_EQ(read_from(first, "color"), triple("ViewLayer.Combined.left"));
  LayerChoice choice;
  choice.view = "right";
  const LayerMap second = map_layers(names, choice);
  EXPECT_EQ(read_from(second, "normal"), triple("ViewLayer.Denoising Normal.right", "XYZ"));
  EXPECT_EQ(second.layers.at("diffuse").terms[1], triple("ViewLayer.DiffDir.right"));
  EXPECT_EQ(second.alpha, "ViewLayer.Combined.right.A");
  choice.view = "middle";
  EXPECT_ERROR(map_layers(names, choice), "'middle'", "'ViewLayer' (view 'left')", "(view 'right')");
}

TEST(LayerMap, SeveralViewLayersAreNeverMixed) {
  // The compositor's layer sorts first but has no passes. The first layer that has passes is taken.
  const Names names = rgba("Composite.Combined") + blender_old("Main") + blender_old("Second");
  EXPECT_EQ(map_layers(names).view_layer, "Main");
  EXPECT_EQ(map_layers(names).others, (Names{"--map viewlayer=Composite", "--map viewlayer=Second"}));
  LayerChoice choice;
  choice.view_layer = "Second";
  const LayerMap map = map_layers(names, choice);
  EXPECT_EQ(read_from(map, "color"), triple("Second.Combined"));
  EXPECT_EQ(read_from(map, "albedo"), triple("Second.Denoising Albedo"));
  EXPECT_EQ(map.others, Names{});
  choice.view_layer = "Composite";
  const LayerMap composite = map_layers(names, choice);
  EXPECT_EQ(read_from(composite, "color"), triple("Composite.Combined"));
  EXPECT_FALSE(composite.layers.contains("albedo"));
  choice.view_layer = "Third";
  EXPECT_ERROR(map_layers(names, choice), "'Third'", "'Main'", "'Second'", "'Composite'");
}

TEST(LayerMap, AlbedoFallsBackToTheDiffuseColourAndSaysSo) {
  const LayerMap map = map_layers(rgba("V.Combined") + rgb("V.DiffCol") + xyz("V.Normal"));
  EXPECT_EQ(read_from(map, "albedo"), triple("V.DiffCol"));
  EXPECT_TRUE(contains(map.layers.at("albedo").note, "no Denoising Albedo"));
  EXPECT_EQ(read_from(map, "normal"), triple("V.Normal", "XYZ"));
  EXPECT_TRUE(contains(layer_map_text(map), "[there is no Denoising Albedo]"));
}

TEST(LayerMap, PlainRgbStandsInForCombined) {
  const Names plain = {"A", "B", "G", "R"};
  const Names passes = rgb("V.Denoising Albedo") + xyz("V.Denoising Normal");
  const LayerMap map = map_layers(plain + passes);
  EXPECT_EQ(map.preset, "cycles");
  EXPECT_EQ(read_from(map, "color"), (ChannelTriple{"R", "G", "B"}));
  EXPECT_EQ(map.alpha, "A");
  EXPECT_EQ(map.layers.at("variance").terms, (std::vector{ChannelTriple{"R", "G", "B"}}));
  EXPECT_EQ(read_from(map, "albedo"), triple("V.Denoising Albedo"));
  EXPECT_TRUE(contains(layer_map_text(map), "R, G, B  [there is no Combined]"));
  const LayerMap both = map_layers(plain + rgb("V.Combined") + passes);
  EXPECT_EQ(read_from(both, "color"), triple("V.Combined"));
  EXPECT_FALSE(both.alpha.has_value());  // A belongs to another picture
}

TEST(LayerMap, Equation2NeedsAllThreePasses) {
  const LayerMap map = map_layers(rgba("V.Combined") + rgb("V.DiffCol") + rgb("V.DiffDir"));
  EXPECT_FALSE(map.layers.contains("diffuse"));
}

TEST(LayerMap, Pbrt) {
  const LayerMap map = map_layers(Names{"B", "G", "R", "dzdx", "u", "v"} + rgb("Albedo") + xyz("N") +
                                  xyz("Ns") + xyz("P") + rgb("RelativeVariance") + rgb("Variance"));
  EXPECT_EQ(map.preset, "pbrt");
  EXPECT_EQ(read_from(map, "color"), (ChannelTriple{"R", "G", "B"}));
  EXPECT_EQ(read_from(map, "albedo"), triple("Albedo"));
  EXPECT_EQ(read_from(map, "normal"), triple("Ns", "XYZ"));
  EXPECT_EQ(read_from(map, "variance"), triple("Variance"));
  EXPECT_FALSE(map.alpha.has_value());
}

TEST(LayerMap, Arnold) {
  const LayerMap map =
      map_layers(Names{"A", "B", "G", "R"} + xyz("N") + rgb("diffuse_albedo") + rgb("diffuse_direct") +
                 rgb("diffuse_indirect") + rgb("specular") + rgb("variance"));
  EXPECT_EQ(map.preset, "arnold");
  EXPECT_EQ(read_from(map, "color"), (ChannelTriple{"R", "G", "B"}));
  EXPECT_EQ(map.alpha, "A");
  EXPECT_EQ(read_from(map, "albedo"), triple("diffuse_albedo"));
  EXPECT_EQ(read_from(map, "normal"), triple("N", "XYZ"));
  EXPECT_EQ(read_from(map, "specular"), triple("specular"));
  EXPECT_EQ(read_from(map, "variance"), triple("variance"));
  EXPECT_EQ(map.layers.at("diffuse").rule, LayerRule::kSum);
  EXPECT_EQ(map.layers.at("diffuse").terms,
            (std::vector{triple("diffuse_direct"), triple("diffuse_indirect")}));
}

TEST(LayerMap, RenderMan) {
  const LayerMap map = map_layers(Names{"Ci.a", "Ci.b", "Ci.g", "Ci.r", "albedo.b", "albedo.g", "albedo.r",
                                        "normal.x", "normal.y", "normal.z"});
  EXPECT_EQ(map.preset, "renderman");
  EXPECT_EQ(read_from(map, "color"), triple("Ci", "rgb"));
  EXPECT_EQ(read_from(map, "albedo"), triple("albedo", "rgb"));
  EXPECT_EQ(read_from(map, "normal"), triple("normal", "xyz"));
  EXPECT_EQ(map.alpha, "Ci.a");
}

TEST(LayerMap, PlainRgbAndGrey) {
  const LayerMap plain = map_layers(Names{"A", "B", "G", "R"});
  EXPECT_EQ(plain.preset, "generic");
  EXPECT_EQ(read_from(plain, "color"), (ChannelTriple{"R", "G", "B"}));
  EXPECT_EQ(plain.alpha, "A");
  EXPECT_EQ(read_from(map_layers(Names{"Y"}), "color"), (ChannelTriple{"Y", "Y", "Y"}));
}

TEST(LayerMap, LuminanceAndChromaAreNoGreyPicture) {
  const Names wanted = {"color"};
  const LayerMap map = map_layers(Names{"BY", "RY", "Y"});
  EXPECT_ERROR(require_layers(map, wanted, "yc.exr"), "yc.exr", "color", "RY", "must be converted");
}

TEST(LayerMap, TheOnlyColoursOfAFileAreTheBeauty) {
  const LayerMap map = map_layers(rgba("some.part") + Names{"depth.Z"});
  EXPECT_EQ(read_from(map, "color"), triple("some.part"));
  EXPECT_EQ(map.alpha, "some.part.A");
  EXPECT_FALSE(map_layers(rgba("one") + rgba("two")).layers.contains("color"));
}

// Houdini's beauty is C; guides that another renderer has too do not decide against it.
TEST(LayerMap, AColorIsWorthMoreThanGuides) {
  const Names guides = {"N.X",
                        "N.Y",
                        "N.Z",
                        "diffuse_albedo.R",
                        "diffuse_albedo.G",
                        "diffuse_albedo.B",
                        "specular_direct.R",
                        "specular_direct.G",
                        "specular_direct.B",
                        "specular_indirect.R",
                        "specular_indirect.G",
                        "specular_indirect.B"};
  EXPECT_EQ(read_from(map_layers(rgba("C") + guides), "color"), triple("C"));
}

TEST(LayerMap, PresetByName) {
  const Names names = Names{"B", "G", "R"} + xyz("N") + rgb("albedo");
  EXPECT_EQ(map_layers(names).preset, "arnold");
  LayerChoice choice;
  choice.preset = "pbrt";
  const LayerMap map = map_layers(names, choice);
  EXPECT_EQ(map.preset, "pbrt");
  EXPECT_EQ(read_from(map, "normal"), triple("N", "XYZ"));
  EXPECT_FALSE(map.layers.contains("albedo"));
  choice.preset = "vray";
  EXPECT_ERROR(map_layers(names, choice), "'vray'", "cycles", "pbrt", "arnold", "renderman");
}

TEST(LayerMap, Overrides) {
  const Names names = blender_old("ViewLayer") + rgb("MyLayer.Alb") + xyz("odd.name") +
                      Names{"m.one", "m.two", "m.three", "matte"};
  const Names items = {"albedo=MyLayer.Alb", "normal=odd.name", "specular=m.one,m.two,m.three",
                       "variance=matte", "alpha=matte"};
  const LayerMap map = map_layers(names, parse_layer_choice(items));
  EXPECT_EQ(read_from(map, "color"), triple("ViewLayer.Combined"));
  EXPECT_EQ(read_from(map, "albedo"), triple("MyLayer.Alb"));
  EXPECT_EQ(read_from(map, "normal"), triple("odd.name", "XYZ"));
  EXPECT_EQ(read_from(map, "specular"), (ChannelTriple{"m.one", "m.two", "m.three"}));
  EXPECT_EQ(read_from(map, "variance"), (ChannelTriple{"matte", "matte", "matte"}));
  EXPECT_EQ(map.alpha, "matte");
}

TEST(LayerMap, AnOverriddenColorBringsItsAlphaAndVariance) {
  const Names items = {"color=Other"};
  const LayerMap map = map_layers(blender_old("V") + rgba("Other"), parse_layer_choice(items));
  EXPECT_EQ(map.alpha, "Other.A");
  EXPECT_EQ(map.layers.at("variance").terms, std::vector{triple("Other")});
}

TEST(LayerMap, OverridesOfWhatIsNotThere) {
  const auto with = [](const std::string& item) {
    map_layers(Names{"R", "G", "B"}, parse_layer_choice(Names{item}));
  };
  EXPECT_ERROR(with("albedo=Nope"), "'albedo'", "'Nope'", "Nope.R");
  EXPECT_ERROR(with("albedo=R,G,Q"), "'albedo'", "'Q'");
  EXPECT_ERROR(with("albedo=R,G"), "'albedo'", "'R,G'");
  EXPECT_ERROR(with("alpha=A"), "alpha", "'A'");
  EXPECT_ERROR(with("albido=R,G,B"), "albido", "albedo");
  EXPECT_ERROR(with("albedo="), "albedo=");
}

TEST(LayerMap, ParsesNamesThatHoldAnEqualsSign) {
  const LayerChoice choice = parse_layer_choice(Names{"cycles", "viewlayer=a=b", "view=left", "color=x=y"});
  EXPECT_EQ(choice.preset, "cycles");
  EXPECT_EQ(choice.view_layer, "a=b");
  EXPECT_EQ(choice.view, "left");
  EXPECT_EQ(choice.overrides.at("color"), "x=y");
}

TEST(LayerMap, NamesEveryMissingLayerAndWhatWasLookedFor) {
  const LayerMap map = map_layers(rgba("V.Combined"));
  const Names wanted = {"color", "albedo", "normal", "diffuse"};
  const std::string message = test::error_of([&] { require_layers(map, wanted, "low.exr"); });
  for (const std::string part :
       {"low.exr", "albedo: looked for", "Denoising Albedo", "diffuse_albedo", "normal: looked for",
        "Denoising Normal",
        "diffuse: looked for diffuse | Diffuse | (DiffCol | Diffuse Color) * ((DiffDir | Diffuse Direct) + "
        "(DiffInd | Diffuse Indirect)) | (diffuse_direct + diffuse_indirect) | "
        "(directDiffuse + indirectDiffuse)"})
    EXPECT_TRUE(contains(message, part)) << message << "\nlacks " << part;
  EXPECT_FALSE(contains(message, "color: looked"));
  const Names unknown = {"depth"};
  EXPECT_ERROR(require_layers(map, unknown, "low.exr"), "'depth'");
}

TEST(LayerMap, NamesEachAlternativeOnce) {
  const Names wanted = {"color", "normal"};
  const std::string message =
      test::error_of([&] { require_layers(map_layers(Names{"Z"}), wanted, "depth.exr"); });
  EXPECT_TRUE(
      contains(message,
               "color: looked for plain R, G, B | rgba | RGBA | rgb | RGB | beauty | Beauty | color | "
               "Color | main | C | Noisy Image | Combined | Ci\n"))
      << message;
  EXPECT_TRUE(contains(message, "normal: looked for normal | Normal | NORMAL | Denoising Normal | N | Ns"))
      << message;
}

TEST(LayerMap, DescribesTheWholeMapping) {
  const std::string text = layer_map_text(map_layers(blender_old("ViewLayer")));
  for (const std::string part : {"preset cycles, view layer 'ViewLayer'",
                                 "color    ViewLayer.Combined.R, ViewLayer.Combined.G, ViewLayer.Combined.B",
                                 "(ViewLayer.DiffCol.R, ", ") * ((ViewLayer.DiffDir.R",
                                 "3x3 variance of (ViewLayer.Combined.R", "alpha    ViewLayer.Combined.A"})
    EXPECT_TRUE(contains(text, part)) << text << "\nlacks " << part;
}

// Writes a file of 2 x 2 pixels whose channels each have the value that stands by their name.
void write_constant(const std::filesystem::path& path, const std::map<std::string, float>& values) {
  std::vector<std::vector<float>> planes;
  ExrOutput output;
  output.source = Imf::Header(2, 2);
  planes.reserve(values.size());
  for (const auto& [name, value] : values)
    output.planes.push_back({name, Imf::FLOAT, planes.emplace_back(4, value).data()});
  write_exr(path, output);
}

TEST(LoadLayers, ComputesDerivedLayersInTheOrderAskedFor) {
  TemporaryDirectory directory;
  std::map<std::string, float> values = {
      {"V.Combined.R", 1}, {"V.Combined.G", 2}, {"V.Combined.B", 3}, {"V.Combined.A", 0.5f}};
  for (const auto& [pass, value] : std::map<std::string, float>{{"DiffCol", 0.5f},
                                                                {"DiffDir", 2},
                                                                {"DiffInd", 4},
                                                                {"GlossCol", 0.25f},
                                                                {"GlossDir", 8},
                                                                {"GlossInd", 16}})
    for (const std::string channel : {"R", "G", "B"})
      values["V." + pass + "." + channel] = value + (channel == "G" ? 1 : 0);
  write_constant(directory / "a.exr", values);
  ExrFile file(directory / "a.exr");
  const Names wanted = {"specular", "color", "diffuse", "variance"};
  const Image image = load_layers(file, map_layers(file), wanted);
  ASSERT_EQ(image.channels, 12);
  // The values are specular 0.25 * 24 and 1.25 * 26, color, diffuse 0.5 * 6 and 1.5 * 8, and no variance.
  const std::vector<float> expected = {6, 32.5f, 6, 1, 2, 3, 3, 12, 3, 0, 0, 0};
  for (int c = 0; c < 12; ++c)
    for (int i = 0; i < 4; ++i) EXPECT_FLOAT_EQ(image.plane(c)[i], expected[size_t(c)]) << "channel " << c;
}

TEST(LoadLayers, AddsDirectAndIndirect) {
  TemporaryDirectory directory;
  std::map<std::string, float> values = {{"R", 1}, {"G", 1}, {"B", 1}};
  for (const std::string channel : {"R", "G", "B"}) {
    values["diffuse_direct." + channel] = 3;
    values["diffuse_indirect." + channel] = 0.125f;
  }
  write_constant(directory / "a.exr", values);
  ExrFile file(directory / "a.exr");
  const Names wanted = {"diffuse"};
  EXPECT_FLOAT_EQ(load_layers(file, map_layers(file), wanted).at(2, 1, 1), 3.125f);
}

TEST(LoadLayers, VarianceIsOfTheColorAndReadWhereTheFileHasOne) {
  TemporaryDirectory directory;
  const std::vector<float> pixels = {9, 0};
  ExrOutput output;
  output.source = Imf::Header(1, 2);
  output.planes = {{"Y", Imf::FLOAT, pixels.data()}};
  write_exr(directory / "grey.exr", output);
  ExrFile grey(directory / "grey.exr");
  const Names wanted = {"variance"};
  const Image estimated = load_layers(grey, map_layers(grey), wanted);
  // Edges repeat, so there are six 9s and three 0s: the mean is 6, and the variance (6 * 9 + 3 * 36) / 9.
  for (int c = 0; c < 3; ++c) EXPECT_FLOAT_EQ(estimated.at(c, 0, 0), 18);
  write_constant(directory / "pbrt.exr",
                 {{"R", 1}, {"G", 1}, {"B", 1}, {"Variance.R", 7}, {"Variance.G", 7}, {"Variance.B", 7}});
  ExrFile pbrt(directory / "pbrt.exr");
  EXPECT_FLOAT_EQ(load_layers(pbrt, map_layers(pbrt), wanted).at(1, 0, 0), 7);
}

TEST(LoadLayers, ErrorsNameTheFile) {
  TemporaryDirectory directory;
  write_constant(directory / "rgb.exr", {{"R", 1}, {"G", 1}, {"B", 1}});
  ExrFile file(directory / "rgb.exr");
  const Names wanted = {"color", "albedo"};
  EXPECT_ERROR(load_layers(file, map_layers(file), wanted), "rgb.exr", "albedo");
  LayerChoice choice;
  choice.overrides["normal"] = "Nope";
  EXPECT_ERROR(map_layers(file, choice), "rgb.exr", "Nope");
}

TEST(Motion, EachPresetSaysWhereItLeads) {
  struct Case {
    const char *channels[2], *preset;
    std::array<float, 2> factors;
    const char* depth;
  };
  const Case cases[] = {
      {{"ViewLayer.Vector.X", "ViewLayer.Vector.Y"}, "cycles", {1, -1}, "ViewLayer.Denoising Depth.Z"},
      {{"motionvector.R", "motionvector.G"}, "arnold", {-1, 1}, "Z"},
      {{"backward.r", "backward.g"}, "renderman", {1, 1}, "z"},
      {{"motion.U", "motion.V"}, "generic", {1, 1}, "depth.Z"},
  };
  for (const auto& [channels, preset, factors, depth] : cases) {
    const Names names = Names{"R", "G", "B", "Ci.r", "Ci.g", "Ci.b", channels[0], channels[1], depth};
    LayerChoice choice;
    choice.preset = preset;
    const LayerMap map = map_layers(names, choice);
    ASSERT_TRUE(map.motion) << preset;
    EXPECT_EQ(map.motion->channels, (std::array<std::string, 2>{channels[0], channels[1]})) << preset;
    EXPECT_EQ(map.motion->factors, factors) << preset;
    EXPECT_EQ(map.depth, depth) << preset;
    choice.overrides["depth"] = "G";
    EXPECT_EQ(map_layers(names, choice).depth, "G") << preset;
    choice.overrides["depth"] = "nope";
    EXPECT_ERROR(map_layers(names, choice), "cannot map depth", "'nope'");
    choice.overrides.clear();
    choice.motion_factors = {2, 3};
    EXPECT_EQ(map_layers(names, choice).motion->factors, (std::array{2.0f, 3.0f})) << preset;
  }
  EXPECT_FALSE(map_layers(Names{"R", "G", "B", "Vector.X"}).motion);
  EXPECT_FALSE(map_layers(Names{"R", "G", "B", "X", "Y", "Z"}).depth) << "these are one group";
  EXPECT_FALSE(map_layers(Names{"R", "G", "B", "U", "V"}).depth);
  EXPECT_EQ(
      map_layers(Names{"Combined.R", "Combined.G", "Combined.B", "Vector.X", "Vector.Y", "Depth.V"}).depth,
      "Depth.V");
}

}  // namespace
}  // namespace raymeld
