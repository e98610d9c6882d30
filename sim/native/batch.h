// Calls a kernel once for each item of a batch.
//
// Kernels are written for one item. Under vmap each operand and result gets leading
// batch axes, as many as all others; an operand's axis of length 1 is shared by the
// whole batch (`vmap_method="expand_dims"`), so that a bank is never copied.

#ifndef DRIVETRAIN_BATCH_H_
#define DRIVETRAIN_BATCH_H_

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <thread>
#include <utility>

#include "xla/ffi/api/ffi.h"

namespace drivetrain {

namespace ffi = xla::ffi;

constexpr int kMaxBatchAxes = 6;
using Place = std::array<int64_t, kMaxBatchAxes>;

// The batch axes of a call, read off a result whose item has `item_rank` axes.
struct BatchShape {
  int rank = 0;
  Place length{};
  int64_t size = 1;

  BatchShape(ffi::AnyBuffer::Dimensions dimensions, int item_rank)
      : rank(static_cast<int>(dimensions.size()) - item_rank) {
    if (rank > kMaxBatchAxes) {
      std::fprintf(stderr, "drivetrain: vmap at most %d deep over the simulator\n",
                   kMaxBatchAxes);
      std::abort();
    }
    for (int axis = 0; axis < rank; ++axis) {
      length[axis] = dimensions[axis];
      size *= dimensions[axis];
    }
  }

  Place place(int64_t item) const {
    Place place{};
    for (int axis = rank - 1; axis >= 0; --axis) {
      place[axis] = item % length[axis];
      item /= length[axis];
    }
    return place;
  }
};

// An operand or result: `at(place)` is the first number of the item at that place.
template <typename T>
class Batched {
 public:
  Batched(const ffi::AnyBuffer& buffer, const BatchShape& batch)
      : Batched(reinterpret_cast<T*>(buffer.untyped_data()), buffer.dimensions(),
                batch) {}

  T* at(const Place& place) const {
    int64_t offset = 0;
    for (int axis = 0; axis < rank_; ++axis) offset += place[axis] * stride_[axis];
    return data_ + offset;
  }

  // The length of an axis of the item.
  int64_t length(int axis) const { return item_length_[axis]; }

 private:
  Batched(T* data, ffi::AnyBuffer::Dimensions dimensions, const BatchShape& batch)
      : data_(data), rank_(batch.rank) {
    int64_t stride = 1;
    const int num_axes = static_cast<int>(dimensions.size());
    for (int axis = num_axes - 1; axis >= rank_; --axis) {
      item_length_[axis - rank_] = dimensions[axis];
      stride *= dimensions[axis];
    }
    for (int axis = rank_ - 1; axis >= 0; --axis) {
      stride_[axis] = dimensions[axis] == 1 ? 0 : stride;
      stride *= dimensions[axis];
    }
  }

  T* data_;
  int rank_;
  Place stride_{};
  Place item_length_{};
};

// The number of an item of `count`: as JAX does, numbers beyond the last mean the last.
inline int64_t clamped(int64_t number, int64_t count) {
  return std::clamp<int64_t>(number, 0, count - 1);
}

// Runs `kernel(place)` for all items, on the threads of the pool where that pays.
//
// The caller works too and waits only for pieces that others have begun, so kernels
// that run on the pool's own threads cannot wait for each other.
template <typename Kernel>
void for_each(ffi::ThreadPool pool, const BatchShape& batch, int64_t items_per_piece,
              const Kernel& kernel) {
  const int64_t num_pieces = (batch.size + items_per_piece - 1) / items_per_piece;
  const auto run = [&](int64_t piece) {
    const int64_t first = piece * items_per_piece;
    const int64_t last = std::min(batch.size, first + items_per_piece);
    for (int64_t item = first; item < last; ++item) kernel(batch.place(item));
  };
  const int64_t num_helpers = std::min(num_pieces, pool.num_threads()) - 1;
  if (num_helpers < 1) {
    for (int64_t piece = 0; piece < num_pieces; ++piece) run(piece);
    return;
  }
  struct Progress {
    std::atomic<int64_t> next{0};
    std::atomic<int64_t> done{0};
  };
  const auto progress = std::make_shared<Progress>();
  // A helper that starts late finds no piece left and touches nothing but `progress`.
  const auto work = [progress, num_pieces, &run] {
    for (int64_t piece; (piece = progress->next.fetch_add(1)) < num_pieces;) {
      run(piece);
      progress->done.fetch_add(1);
    }
  };
  for (int64_t helper = 0; helper < num_helpers; ++helper) {
    auto copy = work;
    pool.Schedule(std::move(copy));
  }
  work();
  while (progress->done.load() < num_pieces) std::this_thread::yield();
}

}  // namespace drivetrain

#endif  // DRIVETRAIN_BATCH_H_
