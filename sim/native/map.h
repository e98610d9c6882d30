// The map of a scenario, as kernels see it: pieces in tiles; see `tiles.py`.

#ifndef DRIVETRAIN_MAP_H_
#define DRIVETRAIN_MAP_H_

#include <cmath>
#include <cstdint>

#include "batch.h"

namespace drivetrain {

constexpr float kTile = 16;       // metres, as in `tiles.py`
constexpr uint8_t kJoined = 32;   // in the tag of a vertex with a segment after it
constexpr int kNumMapOperands = 12;

// A map of one scenario. T is the type of stored coordinates.
template <typename T>
struct Map {
  const float *corner, *centre;
  const int32_t *shape, *starts;
  const uint16_t* pieces;
  const T* vertices;
  const uint8_t* tag;
  float reach, quantum;

  float metres(T stored, int axis) const { return centre[axis] + quantum * stored; }
  float x(int32_t vertex) const { return metres(vertices[3 * vertex], 0); }
  float y(int32_t vertex) const { return metres(vertices[3 * vertex + 1], 1); }
  float z(int32_t vertex) const { return metres(vertices[3 * vertex + 2], 2); }
  // The vertex at which the piece ends that begins at a vertex.
  int32_t end(int32_t vertex) const { return vertex + (tag[vertex] >= kJoined); }

  // Calls `visit(piece)` for all pieces that can lie within a radius of a place.
  template <typename Visit>
  void for_each_piece(float x, float y, float radius, const Visit& visit) const {
    for_each_piece(x, y, radius, [](float, float, float) { return true; }, visit);
  }

  // The same for tiles that are wanted: `wants(x, y, r)` tells it of a tile whose pieces
  // lie within r of a place.
  template <typename Wants, typename Visit>
  void for_each_piece(float x, float y, float radius, const Wants& wants,
                      const Visit& visit) const {
    const float far = radius + reach;
    const int first_column = std::max(0, column(x - far));
    const int last_column = std::min(shape[0] - 1, column(x + far));
    const int last_row = std::min(shape[1] - 1, row(y + far));
    if (first_column > last_column) return;
    const float size = reach + kTile * 0.70711f;
    for (int i = std::max(0, row(y - far)); i <= last_row; ++i) {
      const int32_t* tile = starts + i * shape[0];
      const float middle_y = corner[1] + kTile * (i + 0.5f);
      for (int j = first_column; j <= last_column; ++j) {
        if (tile[j] == tile[j + 1]) continue;
        if (!wants(corner[0] + kTile * (j + 0.5f), middle_y, size)) continue;
        for (int32_t k = tile[j]; k < tile[j + 1]; ++k) visit(pieces[k]);
      }
    }
  }

  int column(float x) const { return tile((x - corner[0]) / kTile, shape[0]); }
  int row(float y) const { return tile((y - corner[1]) / kTile, shape[1]); }

 private:
  // Places far off the map, and NaN, get a tile just outside.
  static int tile(float number, int32_t count) {
    if (!(number > -1e6f)) return -1000000;
    return static_cast<int>(std::floor(std::min(number, count + 1e6f)));
  }
};

// The maps of a bank: the operands from `first` on, in the order of `map_search.py`.
template <typename T>
class Maps {
 public:
  Maps(const ffi::RemainingArgs& args, size_t first, const BatchShape& batch)
      : index_(operand(args, first), batch),
        first_tile_(operand(args, first + 1), batch),
        first_vertex_(operand(args, first + 2), batch),
        shape_(operand(args, first + 3), batch),
        starts_(operand(args, first + 4), batch),
        corner_(operand(args, first + 5), batch),
        centre_(operand(args, first + 6), batch),
        reach_(operand(args, first + 7), batch),
        quantum_(operand(args, first + 8), batch),
        pieces_(operand(args, first + 9), batch),
        tag_(operand(args, first + 10), batch),
        vertices_(operand(args, first + 11), batch) {}

  Map<T> at(const Place& place) const {
    const int64_t scenario = clamped(*index_.at(place), first_vertex_.length(0));
    const int64_t first_vertex = first_vertex_.at(place)[scenario];
    return {
        corner_.at(place) + 2 * scenario,
        centre_.at(place) + 3 * scenario,
        shape_.at(place) + 2 * scenario,
        starts_.at(place) + first_tile_.at(place)[scenario],
        pieces_.at(place) + first_vertex,
        vertices_.at(place) + 3 * first_vertex,
        tag_.at(place) + first_vertex,
        reach_.at(place)[scenario],
        quantum_.at(place)[scenario],
    };
  }

 private:
  static ffi::AnyBuffer operand(const ffi::RemainingArgs& args, size_t i) {
    return *args.get<ffi::AnyBuffer>(i);
  }

  Batched<const int32_t> index_, first_tile_, first_vertex_, shape_, starts_;
  Batched<const float> corner_, centre_, reach_, quantum_;
  Batched<const uint16_t> pieces_;
  Batched<const uint8_t> tag_;
  Batched<const T> vertices_;
};

// Calls `run` with a value of the type of stored coordinates.
template <typename Run>
void with_coordinates(const ffi::RemainingArgs& args, size_t first, const Run& run) {
  const auto type =
      args.get<ffi::AnyBuffer>(first + kNumMapOperands - 1)->element_type();
  type == ffi::DataType::S16 ? run(int16_t{}) : run(float{});
}

}  // namespace drivetrain

#endif  // DRIVETRAIN_MAP_H_
