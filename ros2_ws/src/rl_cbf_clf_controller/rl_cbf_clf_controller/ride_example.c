/* A ride in C: to the readings of a ride in Python the controller answers with the same inputs, to the bit. */
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "controller.h"
#include "ride.h"

int main(void) {
  static double memory[MEMORY_SIZE], settings[SETTINGS_SIZE], report[REPORT_SIZE];
  int differing = 0;
  clock_t begin = clock();
  controller_first(memory);
  controller_settings(settings);
  for (int tick = 0; tick < TICKS; tick++) {
    int code = controller_step(memory, readings[tick], settings, report);
    if (code) {
      printf("tick %d: code %d\n", tick, code);
      return 1;
    }
    differing += memcmp(report + REPORT_COMMAND, inputs[tick], sizeof inputs[tick]) != 0;
  }
  printf("%d ticks, %.1f us each, %d with other inputs than Python's\n", TICKS,
         1e6 * (clock() - begin) / CLOCKS_PER_SEC / TICKS, differing);
  return differing != 0;
}
