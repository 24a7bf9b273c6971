/* Fuses a frame through the installed package, in C. */
#include <raymeld/raymeld.h>
#include <stdio.h>
#include <stdlib.h>

#define HEIGHT 5
#define WIDTH 7

static int failed(void) {
  fprintf(stderr, "%s\n", raymeld_error());
  return 1;
}

int main(int argc, char** argv) {
  raymeld_context context = NULL;
  raymeld_model model = NULL;
  raymeld_fusion fusion = NULL;
  raymeld_fusion_desc desc = {.struct_size = sizeof(desc), .height = HEIGHT, .width = WIDTH};
  raymeld_fusion_info info = {.struct_size = sizeof(info)};
  raymeld_status status = {.struct_size = sizeof(status)};
  size_t i, full;
  float lrhs[3 * HEIGHT * WIDTH], *hrls, *fused;
  double sum = 0;
  if (argc != 2) return 2;
  if (raymeld_model_load("no such file", &model) != RAYMELD_ERROR_MODEL || model) return 1;
  if (raymeld_context_create(NULL, &context) || raymeld_model_load(argv[1], &model) ||
      raymeld_fusion_create(context, model, &desc, &fusion) || raymeld_fusion_get_info(fusion, &info)) {
    return failed();
  }
  raymeld_model_destroy(model); /* the fusion keeps the model */
  raymeld_context_destroy(context);
  full = (size_t)info.scale * HEIGHT * info.scale * WIDTH;
  hrls = malloc(3 * info.layer_count * full * sizeof(float));
  fused = malloc(3 * full * sizeof(float));
  for (i = 0; i < 3 * HEIGHT * WIDTH; ++i) lrhs[i] = 0.5f;
  for (i = 0; i < 3 * info.layer_count * full; ++i) hrls[i] = 0.25f;
  if (raymeld_fuse(fusion, lrhs, hrls, fused, &status)) return failed();
  raymeld_fusion_destroy(fusion);
  for (i = 0; i < 3 * full; ++i) sum += fused[i];
  printf("mean %g\n", sum / (double)(3 * full));
  free(hrls);
  free(fused);
  return sum > 0 ? 0 : 1;
}
