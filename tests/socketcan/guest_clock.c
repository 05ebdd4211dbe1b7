/* The clock of User-mode Linux: time passes while the guest sleeps, and hardly while it computes.
 *
 * Preloaded into linux.uml, it stands between that kernel and the C library's clock and timer. An idle guest is told at
 * once that the time it waits for has come. A busy one gains LOOK for each look at the clock, so that waiting awake ends,
 * and 1/SLOWNESS of the host's time, so that a program that only computes is interrupted. Inside, all is as on a computer
 * that is never late, however busy the host is; the host may be faster or slower than the guest's clock.
 * QEMU's `-icount sleep=off` does the same for a guest that it emulates, and is a hundred times slower.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <signal.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

typedef long long ns;
enum { LOOK = 8000, SLOWNESS = 50 };

static volatile ns now = 1, expiry, interval, host_expiry; /* a timer that repeats has an interval: while Linux boots */
static volatile int armed;
static timer_t timer; /* linux.uml has one */

static ns of(struct timespec t) { return t.tv_sec * 1000000000LL + t.tv_nsec; }
static struct timespec to(ns t) { return (struct timespec){t / 1000000000LL, t % 1000000000LL}; }

static ns host(void)
{
	struct timespec t;
	syscall(SYS_clock_gettime, CLOCK_MONOTONIC, &t);
	return of(t);
}

static void arm(ns left)
{
	static int (*real)(timer_t, int, const struct itimerspec *, struct itimerspec *);
	ns slowness = interval ? 1 : SLOWNESS;
	struct itimerspec on_host = {to(interval * slowness), to(left * slowness)};

	if (!real)
		real = dlsym(RTLD_NEXT, "timer_settime");
	armed = left > 0;
	expiry = now + left;
	host_expiry = host() + left * slowness;
	real(timer, 0, &on_host, 0);
}

static void expire(void)
{
	if (now < expiry)
		now = expiry;
	arm(interval);
	syscall(SYS_tgkill, getpid(), syscall(SYS_gettid), SIGALRM);
}

int timer_settime(timer_t id, int flags, const struct itimerspec *wanted, struct itimerspec *before)
{
	timer = id;
	interval = of(wanted->it_interval);
	arm(of(wanted->it_value));
	return 0;
}

int timer_gettime(timer_t id, struct itimerspec *left)
{
	left->it_interval = to(interval);
	left->it_value = to(!armed ? 0 : expiry > now ? expiry - now : 1);
	return 0;
}

/* Called where the guest is idle, with the alarm blocked. */
int sigsuspend(const sigset_t *mask)
{
	static int (*real)(const sigset_t *);

	if (!real)
		real = dlsym(RTLD_NEXT, "sigsuspend");
	if (armed)
		expire();
	return real(mask);
}

int clock_gettime(clockid_t id, struct timespec *t)
{
	if (id != CLOCK_MONOTONIC)
		return syscall(SYS_clock_gettime, id, t);
	now += LOOK;
	if (armed && now >= expiry) {
		expire();
	} else if (armed && host() >= host_expiry) { /* the host's timer has sent the alarm, or is about to */
		now = expiry;
		armed = interval > 0;
		expiry += interval;
		host_expiry += interval;
	}
	*t = to(now);
	return 0;
}
