#include "pool.hpp"

#include <algorithm>
#include <chrono>
#include <system_error>

namespace romgrl {
namespace {

constexpr std::chrono::microseconds kPatience(20);
constexpr int kLooks = 200;  // between two system calls

template <typename Condition>
void spin(const Condition& condition) {
    const auto end = std::chrono::steady_clock::now() + kPatience;
    do {
        for (int look = 0; look < kLooks; ++look) {
            if (condition()) return;
        }
        std::this_thread::yield();
    } while (std::chrono::steady_clock::now() < end);
}

}  // namespace

Pool::Pool(int threads) {
    try {
        for (int i = 1; i < threads; ++i) threads_.emplace_back([this] { serve(); });
    } catch (const std::system_error&) {
        // The system has no more threads: those that started, and the caller, do the work.
    }
}

Pool::~Pool() {
    {
        const std::lock_guard<std::mutex> lock(mutex_);
        closing_ = true;
    }
    start_.notify_all();
    for (std::thread& thread : threads_) thread.join();
}

void Pool::take(const Work& work, int total, int chunk) {
    for (int begin = next_.fetch_add(chunk); begin < total; begin = next_.fetch_add(chunk)) {
        work(begin, std::min(begin + chunk, total));
    }
}

void Pool::run(int total, const Work& work) {
    if (threads_.empty()) {
        work(0, total);
        return;
    }
    const int chunk = std::max(1, total / (8 * (static_cast<int>(threads_.size()) + 1)));
    {
        const std::lock_guard<std::mutex> lock(mutex_);
        next_ = 0;
        work_ = &work;
        total_ = total;
        chunk_ = chunk;
        ++round_;
    }
    start_.notify_all();
    take(work, total, chunk);
    spin([this] { return busy_ == 0; });
    std::unique_lock<std::mutex> lock(mutex_);
    work_ = nullptr;  // a thread that wakes up only now finds nothing to do
    finish_.wait(lock, [this] { return busy_ == 0; });
}

void Pool::serve() {
    unsigned long seen = 0;
    std::unique_lock<std::mutex> lock(mutex_);
    while (true) {
        start_.wait(lock, [this, seen] { return closing_ || (work_ != nullptr && round_ != seen); });
        if (closing_) return;
        seen = round_;
        ++busy_;
        const Work& work = *work_;
        const int total = total_, chunk = chunk_;
        lock.unlock();
        take(work, total, chunk);
        lock.lock();
        if (--busy_ == 0) finish_.notify_one();
        lock.unlock();
        spin([this, seen] { return round_ != seen; });
        lock.lock();
    }
}

}  // namespace romgrl
