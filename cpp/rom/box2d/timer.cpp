// Box2D reads the system clock fourteen times per step for a profile that nobody reads: a third of all time (measured).
// These definitions come before the library's own when it is linked or loaded, so that its timers stand still.
#pragma GCC visibility push(default)
#include <box2d/b2_timer.h>

b2Timer::b2Timer() { Reset(); }

void b2Timer::Reset() { m_start_sec = m_start_usec = 0; }

float b2Timer::GetMilliseconds() const { return 0.0F; }
#pragma GCC visibility pop
