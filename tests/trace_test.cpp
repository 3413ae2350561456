#include "core/trace.h"

#include <fstream>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "core/types.h"

using namespace isoskin;

TEST(Trace, WritesSpansOnlyWhileEnabled) {
  const auto path = std::filesystem::temp_directory_path() / "isoskin_trace_test.json";
  { Span ignored("ignored"); }
  trace::enable(true);
  { Span span("relax"); }
  trace::enable(false);
  { Span ignored("ignored"); }
  trace::write(path);
  const auto json = nlohmann::json::parse(std::ifstream(path));
  ASSERT_EQ(json["traceEvents"].size(), 1u);
  EXPECT_EQ(json["traceEvents"][0]["name"], "relax");
  EXPECT_EQ(json["traceEvents"][0]["ph"], "X");
  std::filesystem::remove(path);
}

TEST(Trace, UnwritableFileIsOneClearLine) {
  EXPECT_THROW(trace::write("/nowhere/trace.json"), InputError);
}
