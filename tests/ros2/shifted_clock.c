/* Sets the time of day of one process, as somebody would who sets the computer's clock; the monotonic clock stays.
   Loaded by LD_PRELOAD; the file that SHIFTED_CLOCK names holds the shift as a double, in seconds.
   libfaketime 0.9.10 cannot be used: with it, a wait of Python until a monotonic time is an error. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <time.h>

static const volatile double *shift_s;

__attribute__((constructor)) static void begin(void) {
  int file = open(getenv("SHIFTED_CLOCK"), O_RDONLY);
  shift_s = mmap(NULL, sizeof(double), PROT_READ, MAP_SHARED, file, 0);
}

static time_t shift(void) {
  if (!shift_s) begin();
  return (time_t)*shift_s;
}

#define REAL(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))

int clock_gettime(clockid_t which, struct timespec *now) {
  static __typeof__(&clock_gettime) real;
  if (!real) real = REAL(clock_gettime);
  int failed = real(which, now);
  if (!failed && which == CLOCK_REALTIME) now->tv_sec += shift();
  return failed;
}

/* The kernel knows nothing of the shift: a time of day until which somebody waits is shifted back. */
static struct timespec kernel_time(const struct timespec *until) {
  struct timespec shifted = *until;
  if (shifted.tv_sec > 1000000000) shifted.tv_sec -= shift();
  return shifted;
}

int pthread_cond_timedwait(pthread_cond_t *condition, pthread_mutex_t *mutex, const struct timespec *until) {
  struct timespec shifted = kernel_time(until);
  return REAL(pthread_cond_timedwait)(condition, mutex, &shifted);
}

int pthread_mutex_timedlock(pthread_mutex_t *mutex, const struct timespec *until) {
  struct timespec shifted = kernel_time(until);
  return REAL(pthread_mutex_timedlock)(mutex, &shifted);
}

int sem_timedwait(sem_t *semaphore, const struct timespec *until) {
  struct timespec shifted = kernel_time(until);
  return REAL(sem_timedwait)(semaphore, &shifted);
}
