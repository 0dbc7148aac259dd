/* The exported controller walks over stones in MuJoCo: ./example [--bench] [FILE for the torques of all ticks]

   What rabbit_sim does in Python: ten substeps a tick, foot forces averaged over them, a foot that comes down after it
   was clear of the ground is a touchdown, and places and previews the next stone. */
#include <math.h>
#include <mujoco/mujoco.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "controller.h"
#include "course.h" /* where the walk begins, its stones, and the errors of its sensors */

#define TICK_SECONDS 0.01
#define SUBSTEP_SECONDS 0.001

enum { LEFT, RIGHT, SUBSTEPS = 10, DOF = 7, JOINTS = 4, BASE = 3, KEPT = 3, REPLAYED = 1000000 };

typedef struct { double near, far, top; } Span;

static mjModel *model;
static mjData *data;
static int first_stone, first_body;
static Span placed[STONES + 1];
static int stones_placed;

static void place_stones(void) {
  for (int i = 0; i < KEPT; i++) {
    int from = stones_placed > KEPT ? stones_placed - KEPT : 0;
    Span away = {-100, -100, 0}, at = from + i < stones_placed ? placed[from + i] : away;
    double half[3] = {(at.far - at.near) / 2 + FOOT_RADIUS, 0.5, STONE_DEPTH / 2};
    double middle[3] = {(at.near + at.far) / 2, 0, at.top - FOOT_RADIUS - STONE_DEPTH / 2};
    memcpy(model->geom_size + 3 * (first_stone + i), half, sizeof half);
    memcpy(model->geom_aabb + 6 * (first_stone + i) + 3, half, sizeof half);
    model->geom_rbound[first_stone + i] = sqrt(half[0] * half[0] + half[1] * half[1] + half[2] * half[2]);
    memcpy(model->body_pos + 3 * (first_body + i), middle, sizeof middle);
    memcpy(data->mocap_pos + 3 * i, middle, sizeof middle);
  }
}

/* The next stone, seen from a foot that stands at x: index, l_min, l_max, height, into a reading. */
static void stand_at(double x, int touchdowns, double *stone) {
  stone[0] = NAN, stone[1] = NAN, stone[2] = NAN, stone[3] = NAN;
  if (!IS_FLAT && touchdowns < STONES) {
    const double *next = course[touchdowns];
    double before = placed[stones_placed - 1].top;
    placed[stones_placed] = (Span){x + next[0], x + next[1], next[2]};
    stone[0] = touchdowns + 1, stone[1] = placed[stones_placed].near - x, stone[2] = placed[stones_placed].far - x;
    stone[3] = next[2] - before;
    stones_placed++;
  }
  place_stones();
}

/* x, z of both feet: as rabbit_sim/kinematics.py adds them up, to the bit. */
static void locate_feet(double at[2][2]) {
  const double *q = data->qpos;
  for (int leg = LEFT; leg <= RIGHT; leg++) {
    double thigh = q[2] + q[BASE + 2 * leg], shin = thigh + q[BASE + 2 * leg + 1];
    at[leg][0] = q[0] + LINK_LENGTH * -sin(thigh) + LINK_LENGTH * -sin(shin);
    at[leg][1] = q[1] + -LINK_LENGTH * cos(thigh) + -LINK_LENGTH * cos(shin);
  }
}

/* The top of the stone under x, or of the nearest one. */
static double top(double x) {
  double nearest = INFINITY, found = 0;
  for (int i = stones_placed > KEPT ? stones_placed - KEPT : 0; i < stones_placed; i++) {
    double away = fmax(fmax(placed[i].near - x, x - placed[i].far), 0);
    if (away < nearest) nearest = away, found = placed[i].top;
  }
  return found;
}

static double memory[MEMORY_SIZE], settings[SETTINGS_SIZE], report[REPORT_SIZE], readings[MOST_TICKS][READING_SIZE];

#ifdef SENSORS_SIZE
static double sensed[MOST_TICKS][SENSORS_SIZE], path[SUBSTEPS + 1][2 * DOF]; /* q, dq before the tick, after each substep */

static int control(int tick) {
  return controller_step_from_sensors(memory, sensed[tick], readings[tick], settings, report);
}

/* What encoders and IMU say at the end of a tick, as rabbit_sim/perturbations/sensors.py has it, to the bit. */
static void sense(int tick, double *sensors) {
  static double drift = ATTITUDE_ERROR;
  const double *at = path[SUBSTEPS], *before = path[SUBSTEPS - 2], *drawn = noise[tick - 1];
  double force[2] = {0, 0}, half;
  drift += TICK_SECONDS * (GYRO_BIAS + GYRO_NOISE * drawn[0]);
  for (int i = 0; i < SUBSTEPS; i++) {
    double x = (path[i + 1][DOF] - path[i][DOF]) / SUBSTEP_SECONDS - fall[0];
    double z = (path[i + 1][DOF + 1] - path[i][DOF + 1]) / SUBSTEP_SECONDS - fall[1];
    double c = cos((path[i + 1][2] + path[i][2]) / 2), s = sin((path[i + 1][2] + path[i][2]) / 2);
    force[0] += c * x - s * z, force[1] += s * x + c * z;
  }
  for (int i = 0; i < JOINTS; i++) {
    double angle = ENCODER_STEP * rint((at[BASE + i] + encoder_offset[i]) / ENCODER_STEP);
    double earlier = ENCODER_STEP * rint((before[BASE + i] + encoder_offset[i]) / ENCODER_STEP);
    sensors[SENSORS_JOINT_ANGLES + i] = angle;
    sensors[SENSORS_JOINT_RATES + i] = (angle - earlier) / (2 * SUBSTEP_SECONDS);
  }
  for (int i = 0; i < 2; i++)
    sensors[SENSORS_SPECIFIC_FORCE + i] =
        force[i] / SUBSTEPS + (accelerometer_bias[i] + ACCELEROMETER_NOISE * drawn[1 + i]);
  half = (at[2] - SLOPE + drift) / 2;
  sensors[SENSORS_ATTITUDE] = 2 * atan2(sin(half), cos(half)); /* of a quaternion */
  sensors[SENSORS_PITCH_RATE] = at[DOF + 2] + GYRO_BIAS + GYRO_NOISE * drawn[3];
}

static void measure(int tick, const double *force, const int *contact) {
  double *sensors = sensed[tick];
  if (tick) sense(tick, sensors);
  else {
    memcpy(sensors + SENSORS_JOINT_ANGLES, first_angles, sizeof first_angles);
    memcpy(sensors + SENSORS_JOINT_RATES, first_rates, sizeof first_rates);
    sensors[SENSORS_ATTITUDE] = FIRST_ATTITUDE, sensors[SENSORS_PITCH_RATE] = FIRST_PITCH_RATE;
  }
  sensors[SENSORS_TICK] = tick;
  memcpy(sensors + SENSORS_FOOT_FORCE, force, 4 * sizeof(double));
  sensors[SENSORS_CONTACT] = contact[LEFT], sensors[SENSORS_CONTACT + 1] = contact[RIGHT];
}
#else
static int control(int tick) { return controller_step(memory, readings[tick], settings, report); }

static void measure(int tick, const double *force, const int *contact) {
  double *reading = readings[tick];
  reading[READING_TICK] = tick;
  memcpy(reading + READING_Q, data->qpos, DOF * sizeof(double));
  memcpy(reading + READING_DQ, data->qvel, DOF * sizeof(double));
  memcpy(reading + READING_FOOT_FORCE, force, 4 * sizeof(double));
  reading[READING_CONTACT] = contact[LEFT], reading[READING_CONTACT + 1] = contact[RIGHT];
}
#endif

static void keep(int substep) {
#ifdef SENSORS_SIZE
  memcpy(path[substep], data->qpos, DOF * sizeof(double));
  memcpy(path[substep] + DOF, data->qvel, DOF * sizeof(double));
#endif
}

static double now(clockid_t clock) { /* us */
  struct timespec t;
  clock_gettime(clock, &t);
  return t.tv_sec * 1e6 + t.tv_nsec * 1e-3;
}

static int by_size(const void *a, const void *b) {
  double x = *(const double *)a, y = *(const double *)b;
  return (x > y) - (x < y);
}

/* The walk again and again, with a rest before each tick as on a robot: how long a tick takes, by the clock and of the
   processor. The slowest undisturbed one: of each tick of the walk the fastest time, and of these the longest. */
static void bench(int ticks) {
  static double times[REPLAYED], own[REPLAYED], fastest[MOST_TICKS];
  struct timespec rest = {0, 20000};
  double slowest = 0;
  for (int i = 0; i < REPLAYED; i++) {
    int tick = i % ticks;
    if (tick == 0) controller_first(memory);
    nanosleep(&rest, NULL);
    double own_start = now(CLOCK_THREAD_CPUTIME_ID), start = now(CLOCK_MONOTONIC);
    control(tick);
    times[i] = now(CLOCK_MONOTONIC) - start, own[i] = now(CLOCK_THREAD_CPUTIME_ID) - own_start;
    if (i < ticks || times[i] < fastest[tick]) fastest[tick] = times[i];
  }
  for (int i = 0; i < ticks; i++) slowest = fmax(slowest, fastest[i]);
  qsort(times, REPLAYED, sizeof *times, by_size), qsort(own, REPLAYED, sizeof *own, by_size);
  printf("{\"tick_us\": %.3f, \"p99_us\": %.3f, \"worst_us\": %.3f, \"worst_of_processor_us\": %.3f, "
         "\"slowest_undisturbed_us\": %.3f, \"ticks\": %d}\n", times[REPLAYED / 2], times[REPLAYED / 100 * 99],
         times[REPLAYED - 1], own[REPLAYED - 1], slowest, REPLAYED);
}

int main(int count, char **words) {
  int is_bench = count > 1 && !strcmp(words[1], "--bench");
  FILE *file = count > 1 + is_bench ? fopen(words[1 + is_bench], "wb") : NULL;
  model = mj_loadModel("model.mjb", NULL);
  if (!model) return fprintf(stderr, "model.mjb: expected the file beside this program\n"), 2;
  data = mj_makeData(model);
  first_stone = mj_name2id(model, mjOBJ_GEOM, "stone_0"), first_body = model->geom_bodyid[first_stone];
  memcpy(data->qpos, first_q, sizeof first_q), memcpy(data->qvel, first_dq, sizeof first_dq);
  controller_first(memory), controller_settings(settings);
  placed[stones_placed++] = (Span){PLATFORM_START, PLATFORM_END, 0};

  double stone[4], applied[JOINTS] = {NAN, NAN, NAN, NAN}, force[2][2] = {{0}};
  int stance = LEFT, touchdowns = 0, airborne = 0, clear[2] = {0}, contact[2] = {1, 0}, tick = 0;
  double foot[2][2];
  stand_at(0, 0, stone), locate_feet(foot);
  for (;; tick++) {
    double hip = data->qpos[1] - top(data->qpos[0]);
    airborne = contact[LEFT] || contact[RIGHT] ? 0 : airborne + 1;
    if (touchdowns == STONES || !(hip > FALL_HEIGHT) || airborne >= FLIGHT_TICKS || tick == MOST_TICKS) break;
    measure(tick, force[0], contact);
    readings[tick][READING_TOUCHDOWNS] = touchdowns;
    memcpy(readings[tick] + READING_APPLIED, applied, sizeof applied);
    memcpy(readings[tick] + READING_STONE, stone, sizeof stone);
    if (control(tick)) break;
    memcpy(applied, report + REPORT_COMMAND, sizeof applied);
    if (file) fwrite(applied, sizeof applied, 1, file);

    memset(force, 0, sizeof force), memset(contact, 0, sizeof contact);
    for (int leg = LEFT; leg <= RIGHT; leg++) clear[leg] |= foot[leg][1] - top(foot[leg][0]) > CLEAR_HEIGHT;
    memset(data->qacc_warmstart, 0, model->nv * sizeof(double));
    double came_down[2] = {NAN, NAN};
    keep(0);
    for (int substep = 0; substep < SUBSTEPS; substep++) {
      memcpy(data->qfrc_applied + BASE, applied, sizeof applied);
      mj_step(model, data), keep(substep + 1);
      for (int leg = LEFT; leg <= RIGHT; leg++) {
        double x = -data->sensordata[3 * leg], z = -data->sensordata[3 * leg + 2];
        force[leg][0] += x, force[leg][1] += z;
        if (z <= CONTACT_FORCE) continue;
        contact[leg] = 1;
        if (clear[leg] && isnan(came_down[leg])) locate_feet(foot), came_down[leg] = foot[leg][0];
        clear[leg] = 0;
      }
    }
    for (int i = 0; i < 4; i++) force[i / 2][i % 2] /= SUBSTEPS;
    if (!isnan(came_down[1 - stance])) {
      stance = 1 - stance, touchdowns++;
      stand_at(came_down[stance], touchdowns, stone);
    }
    locate_feet(foot);
  }
  if (file) fclose(file);
  if (is_bench) bench(tick);
  else printf("%d of %d stones in %d ticks%s\n", touchdowns, STONES, tick, touchdowns == STONES ? "" : ": it fell");
  return touchdowns == STONES ? 0 : 1;
}
