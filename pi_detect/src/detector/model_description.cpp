#include <pi_detect/model_catalogue.h>
#include <pi_detect/model_description.h>

#include <pi_node/yaml_section.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <sstream>

namespace pi_detect
{
namespace
{

using pi_node::YamlSection;

constexpr int MOST_INPUT_PX = 4096;
constexpr int MAX_CLASSES = 1024;
constexpr int MAX_DETECTIONS = 1024;
constexpr int MAX_BINS = 64;
constexpr int MAX_CLASS_ID = 65535;  // vision_info has a list of all up to the largest

[[noreturn]] void refuse(const std::string& field, const std::string& value, const std::string& bound)
{
  throw ModelError(field + " = " + value + ", must be " + bound);
}

template <typename Value>
void require(bool valid, const std::string& field, const Value& value, const std::string& bound)
{
  if (!valid)
  {
    std::ostringstream text;
    text << value;
    refuse(field, text.str(), bound);
  }
}

bool isWord(const std::string& text)
{
  return !text.empty() && std::all_of(text.begin(), text.end(),
                                      [](unsigned char c) { return std::isalnum(c) != 0 || c == '_' || c == '-'; });
}

template <size_t N>
void readNumbers(YamlSection& section, const std::string& field, std::array<float, N>* numbers)
{
  if (!section.has(field))
  {
    return;
  }
  const auto list = section.get<std::vector<float>>(field, ("a list of " + std::to_string(N) + " numbers").c_str());
  require(list.size() == N, section.name(field), std::to_string(list.size()) + " numbers",
          "a list of " + std::to_string(N) + " numbers");
  std::copy(list.begin(), list.end(), numbers->begin());
}

/// One of several names, as the value it stands for.
template <typename Value>
void readChoice(YamlSection& section, const std::string& field, const std::map<std::string, Value>& choices,
                Value* value)
{
  if (!section.has(field))
  {
    return;
  }
  const auto word = section.get<std::string>(field, "a word");
  const auto choice = choices.find(word);
  if (choice == choices.end())
  {
    std::string list;
    for (const auto& [valid, ignored] : choices)
    {
      list += (list.empty() ? "" : " or ") + valid;
    }
    refuse(section.name(field), "\"" + word + "\"", list);
  }
  *value = choice->second;
}

void validateSum(const std::string& field, const std::string& sum)
{
  const bool valid =
      sum.empty() ||
      (sum.size() == 64 && std::all_of(sum.begin(), sum.end(), [](unsigned char c) { return std::isxdigit(c) != 0; }));
  require(valid, field, "\"" + sum + "\"", "64 hexadecimal digits");
}

/// Puts in the environment's values for ${NAME}.
std::string expand(const std::string& field, const std::string& text)
{
  std::string result;
  size_t at = 0;
  for (size_t begin; (begin = text.find("${", at)) != std::string::npos;)
  {
    const size_t end = text.find('}', begin);
    if (end == std::string::npos)
    {
      refuse(field, "\"" + text + "\"", "a path in which each ${ has its }");
    }
    const std::string variable = text.substr(begin + 2, end - begin - 2);
    const char* value = std::getenv(variable.c_str());
    if (value == nullptr)
    {
      throw ModelError(field + " = \"" + text + "\", but " + variable + " is not set: set it in the environment");
    }
    result += text.substr(at, begin - at) + value;
    at = end + 1;
  }
  return result + text.substr(at);
}

/// The path of a file in the description's folder or, if only there, in another one for weights.
std::filesystem::path find(const std::filesystem::path& path, const std::filesystem::path& folder)
{
  std::error_code error;
  if (path.is_absolute() || std::filesystem::is_regular_file(folder / path, error))
  {
    return folder / path;
  }
  for (const std::string& other : weightsFolders())
  {
    if (std::filesystem::is_regular_file(other / path, error))
    {
      return other / path;
    }
  }
  return folder / path;
}

ModelFile readFile(YamlSection section, const std::filesystem::path& folder)
{
  ModelFile file;
  const std::filesystem::path path = expand(section.name("file"), section.get<std::string>("file", "a path"));
  file.path = find(path, folder).lexically_normal().string();
  section.read("sha256", "64 hexadecimal digits", &file.sha256);
  section.finish();
  return file;
}

/// `scale` for all planes, or `std` by which each plane is divided.
void readScale(YamlSection& section, std::array<float, 3>* scale)
{
  if (!section.has("std"))
  {
    float common = 1.0F;
    section.read("scale", "a number", &common);
    scale->fill(common);
    return;
  }
  require(!section.has("scale"), section.name("std"), "(given)",
          "absent where scale is given: they are two ways to say the same");
  std::array<float, 3> deviation{};
  readNumbers(section, "std", &deviation);
  for (size_t i = 0; i < deviation.size(); ++i)
  {
    require(std::isfinite(deviation[i]) && deviation[i] > 0.0F, section.name("std"), deviation[i], "above 0");
    (*scale)[i] = 1.0F / deviation[i];
  }
}

/// One file, or the first of a list that is there.
ModelFile readWeights(YamlSection& section, const std::filesystem::path& folder)
{
  if (!section.node("weights").IsSequence())
  {
    return readFile(section.section("weights"), folder);
  }
  std::vector<ModelFile> files;
  for (const YamlSection& entry : section.list("weights"))
  {
    files.push_back(readFile(entry, folder));
    validateSum(section.name("weights/sha256"), files.back().sha256);
  }
  require(!files.empty(), section.name("weights"), "(empty)", "a file or a list of them");
  std::error_code error;
  const auto there =
      std::find_if(files.begin(), files.end(),
                   [&error](const ModelFile& file) { return std::filesystem::is_regular_file(file.path, error); });
  return there == files.end() ? files.front() : *there;
}

NetworkInput readInput(YamlSection section)
{
  NetworkInput input;
  input.width = section.get<int>("width", "a whole number");
  input.height = section.get<int>("height", "a whole number");
  readNumbers(section, "mean", &input.mean);
  readScale(section, &input.scale);
  readChoice<bool>(section, "channels", {{"rgb", true}, {"bgr", false}}, &input.rgb);
  readChoice<InputFit>(section, "resize",
                       {{"stretch", InputFit::STRETCH},
                        {"letterbox", InputFit::LETTERBOX},
                        {"letterbox_top_left", InputFit::LETTERBOX_TOP_LEFT}},
                       &input.fit);
  section.read("bar_level", "a whole number", &input.bar_level);
  section.finish();
  return input;
}

CellOutputs readCells(YamlSection& section, OutputKind kind)
{
  CellOutputs cells;
  section.read("strides", "a list of whole numbers", &cells.strides);
  cells.offset = kind == OutputKind::DISTRIBUTION ? 0.5F : 0.0F;
  section.read("offset", "a number", &cells.offset);
  if (kind == OutputKind::DISTRIBUTION)
  {
    section.read("bins", "a whole number", &cells.bins);
  }
  readChoice<bool>(section, "activation", {{"none", false}, {"sigmoid", true}}, &cells.sigmoid);
  section.read("classes", "a whole number", &cells.classes);
  section.read("overlap_threshold", "a number", &cells.overlap_threshold);
  section.read("top_k", "a whole number", &cells.top_k);
  section.read("keep_top_k", "a whole number", &cells.keep_top_k);
  return cells;
}

ModelDescription read(YamlSection section, const std::filesystem::path& folder)
{
  ModelDescription model;
  model.name = section.get<std::string>("name", "a word");
  model.weights = readWeights(section, folder);
  if (section.has("config"))
  {
    model.config = readFile(section.section("config"), folder);
  }
  model.input = readInput(section.section("input"));
  YamlSection output = section.section("output");
  std::map<std::string, OutputKind> kinds;
  for (const OutputKind kind : {OutputKind::DETECTIONS, OutputKind::GRID, OutputKind::DISTRIBUTION})
  {
    kinds[toString(kind)] = kind;
  }
  readChoice<OutputKind>(output, "kind", kinds, &model.output_kind);
  if (model.output_kind != OutputKind::DETECTIONS)
  {
    model.cells = readCells(output, model.output_kind);
  }
  output.finish();
  model.labels = section.get<std::map<int, std::string>>("labels", "a map from class ids to names");
  if (model.cells.classes == 0 && !model.labels.empty())
  {
    model.cells.classes = model.labels.rbegin()->first + 1;
  }
  section.read("score_threshold", "a number", &model.score_threshold);
  if (section.has("tracker"))
  {
    YamlSection tracker = section.section("tracker");
    tracker.read("high_score", "a number", &model.tracker.high);
    tracker.read("low_score", "a number", &model.tracker.low);
    tracker.finish();
  }
  section.read("class_agnostic_overlap", "a number", &model.class_agnostic_overlap);
  section.read("fallback", "a word", &model.fallback);
  section.read("origin", "a text", &model.origin);
  section.read("licence", "a text", &model.licence);
  section.finish();
  return model;
}

void validateInput(const NetworkInput& input)
{
  require(input.width >= 8 && input.width <= MOST_INPUT_PX, "input/width", input.width, "in [8, 4096]");
  require(input.height >= 8 && input.height <= MOST_INPUT_PX, "input/height", input.height, "in [8, 4096]");
  for (const float scale : input.scale)
  {
    require(std::isfinite(scale) && scale != 0.0F, "input/scale", scale, "finite and not 0");
  }
  for (const float mean : input.mean)
  {
    require(std::isfinite(mean), "input/mean", mean, "finite");
  }
  require(input.bar_level >= 0 && input.bar_level <= 255, "input/bar_level", input.bar_level, "in [0, 255]");
}

void validateCells(const CellOutputs& cells, OutputKind kind)
{
  require(!cells.strides.empty(), "output/strides", "(empty)", "a list of whole numbers");
  for (const int stride : cells.strides)
  {
    require(stride >= 1 && stride <= MOST_INPUT_PX, "output/strides", stride, "in [1, 4096]");
  }
  require(cells.offset >= 0.0F && cells.offset <= 1.0F, "output/offset", cells.offset, "in [0, 1]");
  require(kind != OutputKind::DISTRIBUTION || (cells.bins >= 2 && cells.bins <= MAX_BINS), "output/bins", cells.bins,
          "in [2, 64]");
  require(cells.classes >= 1 && cells.classes <= MAX_CLASSES, "output/classes", cells.classes, "in [1, 1024]");
  require(cells.overlap_threshold > 0.0F && cells.overlap_threshold <= 1.0F, "output/overlap_threshold",
          cells.overlap_threshold, "in (0, 1]");
  require(cells.top_k >= 1, "output/top_k", cells.top_k, "at least 1");
  require(cells.keep_top_k >= 1 && cells.keep_top_k <= MAX_DETECTIONS, "output/keep_top_k", cells.keep_top_k,
          "in [1, 1024]");
}

}  // namespace

const char* toString(OutputKind kind)
{
  switch (kind)
  {
    case OutputKind::DETECTIONS:
      return "detections";
    case OutputKind::GRID:
      return "grid";
    case OutputKind::DISTRIBUTION:
      return "distribution";
  }
  return "?";
}

void ModelDescription::validate() const
{
  require(isWord(name), "name", "\"" + name + "\"", "letters, digits, _ and -");
  require(!weights.path.empty(), "weights/file", "\"\"", "a path");
  validateSum("weights/sha256", weights.sha256);
  validateSum("config/sha256", config.sha256);
  validateInput(input);
  if (output_kind != OutputKind::DETECTIONS)
  {
    validateCells(cells, output_kind);
  }
  require(fallback.empty() || isWord(fallback), "fallback", "\"" + fallback + "\"", "letters, digits, _ and -");
  require(!labels.empty(), "labels", "(empty)", "a map from class ids to names");
  for (const auto& [id, label] : labels)
  {
    require(id >= 0, "labels: id", id, "at least 0");
    require(id <= MAX_CLASS_ID, "labels: id", id, "at most " + std::to_string(MAX_CLASS_ID));
    require(!label.empty(), "labels/" + std::to_string(id), "\"\"", "a name");
    if (output_kind != OutputKind::DETECTIONS)
    {
      require(id < cells.classes, "labels: id", id, "a column of the scores");
    }
  }
  require(score_threshold > 0.0F && score_threshold <= 1.0F, "score_threshold", score_threshold, "in (0, 1]");
  require(tracker.high > 0.0 && tracker.high <= 1.0, "tracker/high_score", tracker.high, "in (0, 1]");
  require(tracker.low > 0.0 && tracker.low <= tracker.high, "tracker/low_score", tracker.low, "in (0, high_score]");
  require(class_agnostic_overlap >= 0.0F && class_agnostic_overlap < 1.0F, "class_agnostic_overlap",
          class_agnostic_overlap, "in [0, 1)");
}

int ModelDescription::idOf(const std::string& label) const
{
  const auto found =
      std::find_if(labels.begin(), labels.end(), [&](const auto& entry) { return entry.second == label; });
  return found == labels.end() ? -1 : found->first;
}

ModelDescription ModelDescription::load(const std::string& path)
{
  namespace fs = std::filesystem;
  std::error_code error;
  if (!fs::is_regular_file(path, error))
  {
    throw ModelError(path +
                     ": there is no such file: a model is described by a YAML file, see pi_detect/config/models");
  }
  try
  {
    const YAML::Node root = YAML::LoadFile(path);
    if (!root.IsMap())
    {
      throw std::invalid_argument(path + ": the file must be a map of fields");
    }
    const fs::path absolute = fs::absolute(path);
    ModelDescription model = read(YamlSection(root, path + ":"), absolute.parent_path());
    model.path = absolute.string();
    try
    {
      model.validate();
    }
    catch (const ModelError& error)
    {
      throw ModelError(path + ": " + error.what());
    }
    return model;
  }
  catch (const std::invalid_argument& error)  // of the fields; they name the file
  {
    throw ModelError(error.what());
  }
  catch (const YAML::Exception& error)
  {
    throw ModelError(path + ": " + error.what());
  }
}

}  // namespace pi_detect
