#include "core/topology/surgery.h"

#include "core/topology/surgery_theatre.h"

namespace isoskin {

SurgeryReport create_component(TriangleMesh& mesh, const SurgerySite& site, const Field& field,
                               const SurgeryOptions& options) {
  return surgery::make_shell(mesh, {site, field, options, surgery::Matter::solid});
}

SurgeryReport destroy_component(TriangleMesh& mesh, const SurgerySite& site, const Field& field,
                                const SurgeryOptions& options) {
  return surgery::remove_shell(mesh, {site, field, options, surgery::Matter::solid});
}

SurgeryReport connect(TriangleMesh& mesh, const SurgerySite& site, const Field& field, const SurgeryOptions& options) {
  return surgery::join(mesh, {site, field, options, surgery::Matter::solid});
}

SurgeryReport cut(TriangleMesh& mesh, const SurgerySite& site, const Field& field, const SurgeryOptions& options) {
  return surgery::sever(mesh, {site, field, options, surgery::Matter::solid});
}

SurgeryReport pierce(TriangleMesh& mesh, const SurgerySite& site, const Field& field, const SurgeryOptions& options) {
  return surgery::join(mesh, {site, field, options, surgery::Matter::hollow});
}

SurgeryReport spackle(TriangleMesh& mesh, const SurgerySite& site, const Field& field, const SurgeryOptions& options) {
  return surgery::sever(mesh, {site, field, options, surgery::Matter::hollow});
}

SurgeryReport open_bubble(TriangleMesh& mesh, const SurgerySite& site, const Field& field,
                          const SurgeryOptions& options) {
  return surgery::make_shell(mesh, {site, field, options, surgery::Matter::hollow});
}

SurgeryReport burst_bubble(TriangleMesh& mesh, const SurgerySite& site, const Field& field,
                           const SurgeryOptions& options) {
  return surgery::remove_shell(mesh, {site, field, options, surgery::Matter::hollow});
}

}  // namespace isoskin
