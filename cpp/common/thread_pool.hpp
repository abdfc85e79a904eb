// Worker threads that live as long as their batch and share the items of a loop in small chunks.
//
// Every thread has its own part of the items, so that they stay in the cache of its core, takes it in chunks, and then helps
// the others: on a busy machine the caller does the work of a thread that is not scheduled, instead of waiting for it.
// A step takes some ten microseconds and waking a thread as many, so a thread without work looks for more, yielding its
// core, for a moment before it sleeps.
#pragma once

#include <atomic>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace romgrl {

class Pool {
  public:
    using Work = std::function<void(int, int)>;  // items begin to end

    explicit Pool(int threads);  // the caller is one of them
    ~Pool();
    Pool(const Pool&) = delete;
    Pool& operator=(const Pool&) = delete;

    // Calls `work` on all of 0..total in chunks, on any thread in any order; returns when all are done. Work must not throw.
    void run(int total, const Work& work);

  private:
    struct alignas(64) Part {
        std::atomic<int> next{0};
        int end = 0;
    };

    void serve(int own);
    bool wait_for_round(unsigned long seen);  // false: the pool closes
    void take(int own);  // all chunks that are left, those of its own part first
    void leave();

    // A round is open from run() until the caller finds no more items; then it waits for those who are still inside.
    static constexpr int kClosed = 1 << 30;
    alignas(64) std::atomic<int> gate_{kClosed};  // threads inside, and kClosed
    alignas(64) std::atomic<unsigned long> round_{0};
    std::atomic<int> sleeping_{0};
    std::atomic<bool> closing_{false};
    const Work* work_ = nullptr;  // of the open round
    int chunk_ = 1;
    std::vector<Part> parts_;  // one per thread; the caller's is the first

    std::mutex mutex_;
    std::condition_variable start_, finish_;
    std::vector<std::thread> threads_;  // last: they use all of the above
};

}  // namespace romgrl
