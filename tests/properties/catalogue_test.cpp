// The systems of experiments/systems, read as files.

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <sstream>

#include <kfstab/filters/registry.hpp>

#include "systems.hpp"

namespace kfstab::properties::testing {
namespace {

const std::filesystem::path catalogue_folder = std::filesystem::path(KFSTAB_SOURCE_DIR) / "experiments/systems";

std::vector<std::string> names() {
  std::vector<std::string> all;
  for (const auto& file : std::filesystem::directory_iterator(catalogue_folder))
    if (file.path().extension() == ".toml") all.push_back(file.path().stem().string());
  std::ranges::sort(all);
  return all;
}

class Catalogue : public ::testing::TestWithParam<std::string> {
 protected:
  System system() const { return read_system(catalogue_folder / (GetParam() + ".toml")); }
};

TEST_P(Catalogue, ReadsAndWrites) {
  const System read = system();
  EXPECT_EQ(read.name, GetParam());
  EXPECT_FALSE(read.description.empty());
  EXPECT_FALSE(read.source.empty());
  expect_same(read_toml(write_system(read)), read);
}

TEST_P(Catalogue, ConvertsToEveryFormThatApplies) {
  const System read = system();
  for (const Metadata& filter : filters()) {
    const auto why = refusal(filter, read);
    const bool form_exists = !std::holds_alternative<Refusal>(problem(read, filter.takes));
    EXPECT_TRUE(form_exists || (why && filter.takes == Parametrisation::information)) << filter.id;
    // What exists in a filter's form may be refused for what the filter itself cannot do.
    const bool own = (filter.needs.time_invariant && !read.time_invariant()) || filter.needs.positive_definite_R;
    EXPECT_TRUE(!form_exists || !why || own) << why->reason;
  }
}

TEST_P(Catalogue, EveryFilterStepsThroughIt) {
  const System read = system();
  for (const Metadata& metadata : filters()) {
    if (refusal(metadata, read)) continue;
    const auto any = std::get<AnyProblem<double>>(problem(read, metadata.takes));
    const auto filter = make_filter<double>(metadata.id);
    filter->start(any);
    const auto stream = read.data ? read.data->open() : nullptr;
    for (std::int64_t k = 0; k < std::min<std::int64_t>(read.steps, 20); ++k) {
      const StepData* data = stream ? &stream->next() : nullptr;
      const auto step = filter->step(k, data ? &data->y : nullptr, data ? &data->u : nullptr);
      EXPECT_NE(step.report.status, Status::non_finite_input) << metadata.id;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Systems, Catalogue, ::testing::ValuesIn(names()), [](const auto& parameter) {
  std::string name = parameter.param;
  std::ranges::replace(name, '-', '_');
  return name;
});

TEST(TheCatalogue, HasTheSystemsThatTheDocumentationLists) {
  std::ifstream file(std::filesystem::path(KFSTAB_SOURCE_DIR) / "docs/systems.md");
  std::stringstream text;
  text << file.rdbuf();
  EXPECT_GE(names().size(), 15U);
  for (const std::string& name : names()) EXPECT_NE(text.str().find("`" + name + "`"), std::string::npos) << name;
}

TEST(TheCatalogue, Fb01sdConvertsToItsDocumentedInput) {
  const System system = read_system(catalogue_folder / "slicot-fb01sd.toml");
  const auto any = std::get<AnyProblem<double>>(problem(system, Parametrisation::information));
  const auto& model = std::get<Problem<InformationModel<double>>>(any).models[1];
  EXPECT_NEAR(model.A_inverse(0, 0), 0.2113, 1e-14);
  EXPECT_NEAR(model.A_inverse(3, 1), 0.6525, 1e-14);
  EXPECT_NEAR(model.A_inverse_B(0, 0), -0.8805, 1e-14);
  EXPECT_NEAR(model.A_inverse_B(3, 1), 1.1688, 1e-14);
  EXPECT_NEAR(model.Q_inverse_root(0, 0), 1.1159, 1e-14);
  EXPECT_NEAR(model.Q_inverse_root(0, 1), 0.2305, 1e-14);
  EXPECT_NEAR(model.Q_inverse_root(1, 1), 0.6597, 1e-14);
}

TEST(TheCatalogue, Fb01sdFilteredStateIsTheDocumentedOne) {
  const System system = read_system(catalogue_folder / "slicot-fb01sd.toml");
  const auto any = std::get<AnyProblem<double>>(problem(system, Parametrisation::information));
  const auto filter = make_filter<double>("srif");
  filter->start(any);
  const auto stream = system.data->open();
  Vector<double> state;
  Matrix<double> T;
  for (std::int64_t k = 0; k < system.steps; ++k) {
    const StepData& data = stream->next();
    const auto step = filter->step(k, &data.y, &data.u);
    ASSERT_TRUE(step.report) << k;
    state = *step.state;
    T = *step.held;
  }
  const double documented[] = {-0.7125, -1.8324, 1.75, 1.5854};
  for (Index i = 0; i < 4; ++i) EXPECT_NEAR(state(i), documented[i], 5e-5);
  EXPECT_NEAR(std::abs(T(0, 0)), 0.6897, 5e-5);
  EXPECT_NEAR(std::abs(T(3, 3)), 0.3708, 5e-5);
}

}  // namespace
}  // namespace kfstab::properties::testing
