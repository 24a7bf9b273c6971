// Tests the page that `raymeld trade` fills, src/cli/trade/trade.html, in Debian's headless Chromium.
#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <regex>
#include <string_view>
#include <system_error>

#include "support.h"

namespace raymeld::test {
namespace {

using Json = nlohmann::json;

constexpr const char* kPlots[] = {"time", "memory", "total", "scenes"};

struct Setting {
  int id, scale;
  const char* model;
  const char* precision = "fp32";
  const char* kernels = "auto";
  double time_ms, psnr_db;
  bool front = true;
};

Json setting(const Setting& s) {
  return {{"id", s.id},
          {"scale", s.scale},
          {"model", s.model},
          {"precision", s.precision},
          {"kernels", s.kernels},
          {"lrhs_spp", 16},
          {"hrls_spp", 1},
          {"time_ms", {{"lower", s.time_ms * 0.9}, {"median", s.time_ms}, {"upper", s.time_ms * 1.2}}},
          {"memory_bytes", 64 << 20},
          {"psnr_db", s.psnr_db},
          {"relmse", 0.0036},
          {"fp64_error", 0.01},
          {"time_front", s.front},
          {"memory_front", s.front}};
}

// A scale of 1 stands for a render that is not fused.
struct Render {
  int scale = 1;
  const char* model = "";
  int lrhs_spp = 0, hrls_spp = 1;
  double psnr_db;
  bool front = true;
};

Json render(const Render& r) {
  return {{"scale", r.scale},
          {"model", r.model},
          {"lrhs_spp", r.lrhs_spp},
          {"hrls_spp", r.hrls_spp},
          {"render_s", 1.5 * r.hrls_spp},
          {"fuse_s", r.scale == 1 ? 0 : 0.5},
          {"psnr_db", r.psnr_db},
          {"relmse", 0.01},
          {"front", r.front}};
}

// Returns a report of two views and four settings of two models of two scales. Settings 0 and 3 are defaults.
Json small_report() {
  Json report{
      {"raymeld", "0.1.0"},
      {"device", "a device"},
      {"driver", "a driver"},
      {"data", "two views"},
      {"views",
       {{{"name", "near"}, {"width", 64}, {"height", 48}}, {{"name", "far"}, {"width", 64}, {"height", 48}}}},
      {"settings",
       {setting({.id = 0, .scale = 4, .model = "x4-fast", .time_ms = 500, .psnr_db = 33.1}),
        setting(
            {.id = 1, .scale = 4, .model = "x4-fast", .kernels = "direct", .time_ms = 400, .psnr_db = 33}),
        setting({.id = 2,
                 .scale = 4,
                 .model = "x4-fast",
                 .precision = "fp16",
                 .time_ms = 900,
                 .psnr_db = 33.05,
                 .front = false}),
        setting({.id = 3, .scale = 8, .model = "x8-fast", .time_ms = 300, .psnr_db = 31})}},
      {"renders",
       {render({.psnr_db = 20}), render({.hrls_spp = 4, .psnr_db = 26, .front = false}),
        render({.scale = 4, .model = "x4-fast", .lrhs_spp = 16, .psnr_db = 33})}},
      {"measurements", Json::array()},
      {"strips",
       {{{"title", "near: the worst of 2"},
         {"images", {"bicubic LRHS", "reference"}},
         {"width", 1},
         {"height", 1},
         {"png",
          "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6fptVAAAACklEQVR4nGNgAAAAAgABSK+kcQAAAABJRU5ErkJggg=="}}}}};
  for (const char* view : {"near", "far"}) {
    for (int id = 0; id < 4; ++id) {
      report["measurements"].push_back(
          {{"view", view}, {"setting", id}, {"time_ms", 500}, {"psnr_db", 30 + id}, {"relmse", 0.01}});
    }
  }
  return report;
}

// Returns the same structure with null for every number, text and switch.
Json without_values(const Json& json) {
  if (!json.is_structured()) return nullptr;
  Json result = json;
  for (Json& value : result) value = without_values(value);
  return result;
}

size_t count(std::string_view text, std::string_view what) {
  size_t found = 0;
  for (size_t at = text.find(what); at != text.npos; at = text.find(what, at + what.size())) ++found;
  return found;
}

// Returns the page's text from `<name id="id"` to the element's end, or an empty string where there is none.
std::string element(const std::string& page, const std::string& name, const std::string& id) {
  const size_t begin = page.find("<" + name + " id=\"" + id + "\""),
               end = page.find("</" + name + ">", begin);
  return begin == page.npos || end == page.npos ? "" : page.substr(begin, end + name.size() + 3 - begin);
}

bool is_broken(const std::string& page) { return page.find("<body data-error") != page.npos; }

class TradePage : public testing::Test {
 protected:
  void SetUp() override {
    try {
      run_process({"chromium", "--version"});
    } catch (const std::system_error&) {
      GTEST_SKIP() << "no browser: Debian's package chromium is not installed";
    }
  }

  // Returns what a browser makes of a file. Root cannot have the sandbox, and these files need none.
  std::string browse(const std::string& name, const std::string& content) const {
    write_file(folder_ / name, content);
    const std::string home = folder_.path().string();
    const ProcessResult result =
        run_process({"timeout", "120", "chromium", "--headless", "--no-sandbox", "--disable-gpu",
                     "--user-data-dir=" + home + "/profile", "--dump-dom", "file://" + home + "/" + name},
                    {.environment = {{"HOME", home}}});
    EXPECT_EQ(result.exit_status, 0) << result.err;
    return result.out;
  }

  // Returns what a browser makes of the page, with the report where the program puts it, and `more` at its
  // end.
  std::string show(const Json& report, const std::string& more = "") const {
    const std::string place = "<script type=\"application/json\" id=\"data\">{}</script>\n";
    std::string page = read_file(source_path("src/cli/trade/trade.html"));
    EXPECT_EQ(count(page, place), 1u);
    const std::string json = std::regex_replace(report.dump(), std::regex("<"), "\\u003c");
    page.replace(page.find(place) + place.find("{}"), 2, json);
    return browse("trade.html", page + more);
  }

  TemporaryDirectory folder_;
};

TEST_F(TradePage, EveryMeasurementIsAPointAndARow) {
  const std::string page = show(small_report());
  EXPECT_FALSE(is_broken(page)) << page;
  const size_t points[] = {4, 4, 3, 4}, filled[] = {3, 3, 2, 4}, rows[] = {4, 4, 3, 2};
  for (size_t i = 0; i < std::size(kPlots); ++i) {
    const std::string plot = element(page, "svg", kPlots[i]);
    EXPECT_EQ(count(plot, "point\""), points[i]) << kPlots[i];
    EXPECT_EQ(count(plot, "class=\"point\""), filled[i]) << kPlots[i];
    EXPECT_EQ(count(plot, "<title>"), points[i]) << kPlots[i];
    EXPECT_EQ(count(element(page, "details", std::string(kPlots[i]) + "-table"), "<tr>"), 1 + rows[i])
        << kPlots[i];
  }
  for (const char* text :
       {"raymeld 0.1.0 fused 2 views of two views (64x48) in 4 settings of 2 models on a device, "
        "driver a driver.",
        "<title>x4-fast, fp32, kernels direct, 16-1: 400.0 ms, 33.00 dB</title>",
        "<title>plain render, 4 spp: 6.00 s, 26.00 dB</title>",
        "<title>far, x8-fast, fp32, kernels auto, 16-1: 33.00 dB</title>", ">direct</text>",
        ">near: the worst of 2</figcaption>", "<span>bicubic LRHS</span>"})
    EXPECT_NE(page.find(text), page.npos) << text;
}

TEST_F(TradePage, LoadsNothing) {
  std::string page = show(small_report());
  EXPECT_EQ(count(page, "<img src=\"data:image/png;base64,iVBOR"), 1u);
  for (const char* own : {"xmlns=\"http://www.w3.org/2000/svg\"", "src=\"data:image/png;base64,"})
    page = std::regex_replace(page, std::regex(own), "");
  for (const char* loading : {"http", "//www", "src=", "href=", "url(", "@import", "fetch(", "import("})
    EXPECT_EQ(page.find(loading), page.npos) << loading;
}

TEST_F(TradePage, WithoutValuesThereIsAPageWithoutPoints) {
  const Json report = small_report();
  Json empty = report;
  for (Json& value : empty) {
    if (value.is_array()) value = Json::array();
  }
  for (const Json& nothing : {Json::object(), empty, without_values(report), Json{{"views", nullptr}}}) {
    const std::string page = show(nothing);
    EXPECT_FALSE(is_broken(page)) << nothing;
    EXPECT_EQ(count(page, "Nothing was measured.</text>"), 4u) << nothing;
    for (const char* plot : kPlots) EXPECT_EQ(count(element(page, "svg", plot), "point\""), 0u) << nothing;
  }
}

TEST_F(TradePage, SingleNullsAreLeftOutOfThePlotsOnly) {
  Json report = small_report();
  report["settings"][0]["psnr_db"] = nullptr;
  report["settings"][2]["time_ms"] = nullptr;
  report["renders"][1]["fuse_s"] = nullptr;  // a plain render has none
  report["renders"][2]["fuse_s"] = nullptr;
  report["measurements"][0]["psnr_db"] = nullptr;
  const std::string page = show(report);
  EXPECT_FALSE(is_broken(page)) << page;
  const size_t points[] = {2, 3, 2, 3};
  for (size_t i = 0; i < std::size(kPlots); ++i)
    EXPECT_EQ(count(element(page, "svg", kPlots[i]), "point\""), points[i]) << kPlots[i];
  EXPECT_EQ(count(element(page, "details", "time-table"), "<tr>"), 5u);
}

TEST_F(TradePage, NamesAreTextWhateverTheyHold) {
  Json report = small_report();
  report["views"][0]["name"] = "</script><img src=x onerror='throw 1'>&amp;";
  for (Json& of : report["measurements"])
    if (of["view"] == "near") of["view"] = report["views"][0]["name"];
  const std::string page = show(report);
  EXPECT_FALSE(is_broken(page)) << page;
  EXPECT_EQ(count(page, "<img"), 1u);
  EXPECT_EQ(count(element(page, "svg", "scenes"),
                  ">&lt;/script&gt;&lt;img src=x onerror='throw 1'&gt;&amp;amp;</text>"),
            1u);
}

TEST_F(TradePage, ErrorsAreSaid) { EXPECT_TRUE(is_broken(show({{"settings", 5}}))); }

TEST_F(TradePage, TablesAreSortedByAClick) {
  Json report = small_report();
  report["settings"][0]["time_ms"] = nullptr;
  const auto order = [&](const std::string& clicks) {
    const std::string table =
        element(show(report, "<script>const ms = document.querySelectorAll('#time-table button')[5];" +
                                 clicks + "</script>"),
                "details", "time-table");
    std::string shown;
    for (const char* text : {">300.0<", ">400.0<", ">900.0<", ">33.10<"})
      shown += std::to_string(count(table.substr(0, table.find(text)), "<tr>") - 1);
    return shown;
  };
  EXPECT_EQ(order(""), "4231");
  EXPECT_EQ(order("ms.click();"), "1234");
  EXPECT_EQ(order("ms.click(); ms.click();"), "3214") << "what is not known comes last";
}

// The plots are tested as scripts/trade writes them to docs/.
TEST_F(TradePage, PlotsAreFilesOfTheirOwn) {
  const std::string page = show(small_report());
  for (const char* name : kPlots) {
    const std::string plot = element(page, "svg", name), file = browse("plot.svg", plot);
    EXPECT_EQ(plot.find('\n'), plot.npos) << name;
    EXPECT_EQ(file.find("parsererror"), file.npos) << file;
    EXPECT_EQ(count(file, "point\""), count(plot, "point\"")) << name;
    EXPECT_EQ(count(file, "var(--"), 0u) << name;
  }
}

}  // namespace
}  // namespace raymeld::test
