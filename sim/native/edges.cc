// Finds the nearest road edge of points; see `edge_search.py`.

#include <cmath>
#include <limits>

#include "batch.h"
#include "map.h"

namespace drivetrain {
namespace {

constexpr int kBlock = 4;         // segments, as in `edge_index.py`
constexpr int kMaxBlocks = 8;     // of a leaf
constexpr int kLevels = 6;        // of the tree
constexpr int kCountBits = 4;     // of a leaf's number of blocks
constexpr float kRootCell = 32;   // metres
constexpr float kHeightWeight = 2;

// The tables of a bank that the search reads, and the operands in their order.
template <typename T>
struct Edges {
  Batched<const float> points;
  Batched<const int32_t> index;
  Batched<const float> corner;
  Batched<const int32_t> shape, first_node, nodes, first_block;
  Batched<const uint16_t> blocks;
  Batched<const int32_t> first_vertex, num_edge_vertices;
  Batched<const T> vertices;
  Batched<const uint8_t> tag;
  Batched<const float> centre, quantum;
};

template <typename T>
int32_t nearest(const Edges<T>& edges, const Place& place, const float* point) {
  const int32_t scenario = *edges.index.at(place);
  const float* corner = edges.corner.at(place) + 2 * scenario;
  const int32_t* shape = edges.shape.at(place) + 2 * scenario;
  if (shape[0] <= 0) return -1;
  const int32_t* nodes =
      edges.nodes.at(place) + edges.first_node.at(place)[scenario];
  float inside[2];
  int32_t root[2];
  for (int axis = 0; axis < 2; ++axis) {
    const float rim = std::max(shape[axis] * kRootCell - 1e-3f, 0.0f);
    const float offset = point[axis] - corner[axis];
    inside[axis] = offset > 0 ? std::min(offset, rim) : 0.0f;  // NaN goes to 0
    root[axis] = static_cast<int32_t>(inside[axis] / kRootCell);
  }
  int32_t node = nodes[root[1] * shape[0] + root[0]];
  float cell = kRootCell;
  for (int level = 1; level < kLevels && node < 0; ++level) {
    cell /= 2;
    const int x = static_cast<int32_t>(inside[0] / cell) % 2;
    const int y = static_cast<int32_t>(inside[1] / cell) % 2;
    node = nodes[-node + 2 * y + x];
  }
  const int count = node & ((1 << kCountBits) - 1);
  const uint16_t* list = edges.blocks.at(place) +
                         edges.first_block.at(place)[scenario] + (node >> kCountBits);
  const int32_t first_vertex = edges.first_vertex.at(place)[scenario];
  const int32_t num_vertices = edges.num_edge_vertices.at(place)[scenario];
  const T* vertices = edges.vertices.at(place) + 3 * int64_t{first_vertex};
  const uint8_t* tag = edges.tag.at(place) + first_vertex;
  const float quantum = edges.quantum.at(place)[scenario];
  const float* centre = edges.centre.at(place) + 3 * scenario;

  constexpr float stretch[3] = {1, 1, kHeightWeight};
  float best = std::numeric_limits<float>::infinity();
  int32_t found = -1;
  for (int i = 0; i < count; ++i) {
    const int32_t first = kBlock * int32_t{list[i]};
    const T* block = vertices + 3 * first;
    float squared[kBlock];
    for (int segment = 0; segment < kBlock; ++segment) {
      float along_sq = 0, along_offset = 0;
      float along[3], offset[3];
      for (int axis = 0; axis < 3; ++axis) {
        const float start = centre[axis] + quantum * block[3 * segment + axis];
        const float end = centre[axis] + quantum * block[3 * segment + 3 + axis];
        along[axis] = (end - start) * stretch[axis];
        offset[axis] = (point[axis] - start) * stretch[axis];
        along_sq += along[axis] * along[axis];
        along_offset += along[axis] * offset[axis];
      }
      const float raw = along_offset / (along_sq > 0 ? along_sq : 1.0f);
      const float share = std::min(std::max(raw, 0.0f), 1.0f);
      squared[segment] = 0;
      for (int axis = 0; axis < 3; ++axis) {
        const float apart = offset[axis] - share * along[axis];
        squared[segment] += apart * apart;
      }
    }
    for (int segment = 0; segment < kBlock; ++segment) {
      const int32_t number = first + segment;
      if (number >= num_vertices || tag[number] < kJoined) continue;
      if (!(squared[segment] < best)) continue;
      best = squared[segment];
      found = number;
    }
  }
  return found;
}

template <typename T>
void search(ffi::ThreadPool pool, ffi::RemainingArgs args, ffi::AnyBuffer result) {
  const BatchShape batch(result.dimensions(), 1);
  const auto operand = [&](size_t i) { return *args.get<ffi::AnyBuffer>(i); };
  const Edges<T> edges{
      {operand(0), batch},  {operand(1), batch},  {operand(2), batch},
      {operand(3), batch},  {operand(4), batch},  {operand(5), batch},
      {operand(6), batch},  {operand(7), batch},  {operand(8), batch},
      {operand(9), batch},  {operand(10), batch}, {operand(11), batch},
      {operand(12), batch}, {operand(13), batch},
  };
  const Batched<int32_t> found(result, batch);
  const int64_t num_points = found.length(0);
  const int64_t items_per_piece = std::max<int64_t>(1, 256 / std::max<int64_t>(1, num_points));
  for_each(pool, batch, items_per_piece, [&](const Place& place) {
    const float* points = edges.points.at(place);
    int32_t* out = found.at(place);
    for (int64_t i = 0; i < num_points; ++i) {
      out[i] = nearest(edges, place, points + 3 * i);
    }
  });
}

ffi::Error nearest_edges(ffi::ThreadPool pool, ffi::RemainingArgs args,
                         ffi::Result<ffi::AnyBuffer> found) {
  const bool quantized =
      args.get<ffi::AnyBuffer>(10)->element_type() == ffi::DataType::S16;
  quantized ? search<int16_t>(pool, args, *found) : search<float>(pool, args, *found);
  return ffi::Error::Success();
}

}  // namespace

XLA_FFI_DEFINE_HANDLER_SYMBOL(
    drivetrain_nearest_edges, nearest_edges,
    ffi::Ffi::Bind().Ctx<ffi::ThreadPool>().RemainingArgs().Ret<ffi::AnyBuffer>());

}  // namespace drivetrain
