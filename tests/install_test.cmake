# cmake -DBUILD=<build folder> -DSOURCE=<repository> -DWORK=<scratch folder> -P install_test.cmake
# Installs isoskin under WORK, builds the README's example against it with find_package and runs it.
function(run)
  execute_process(COMMAND ${ARGV} RESULT_VARIABLE status OUTPUT_VARIABLE text ERROR_VARIABLE text)
  if(NOT status EQUAL 0)
    string(JOIN " " command ${ARGV})
    message(FATAL_ERROR "${command}\nended with ${status}:\n${text}")
  endif()
endfunction()

file(REMOVE_RECURSE ${WORK})
run(${CMAKE_COMMAND} --install ${BUILD} --prefix ${WORK}/prefix)

# The README shows this very example.
if(EXISTS ${SOURCE}/README.md)
  file(READ ${SOURCE}/README.md readme)
  file(READ ${SOURCE}/tests/consumer/main.cpp example)
  string(FIND "${readme}" "${example}" at)
  if(at EQUAL -1)
    message(FATAL_ERROR "README.md does not hold tests/consumer/main.cpp word for word")
  endif()
endif()

run(${CMAKE_COMMAND} -S ${SOURCE}/tests/consumer -B ${WORK}/consumer -G Ninja -DCMAKE_BUILD_TYPE=${TYPE}
  -DCMAKE_PREFIX_PATH=${WORK}/prefix "-DCMAKE_CXX_FLAGS=${FLAGS}")
run(${CMAKE_COMMAND} --build ${WORK}/consumer)
run(${CMAKE_COMMAND} -E chdir ${WORK} ${WORK}/consumer/consumer ${SOURCE}/tests/data/two_points.toml)
run(${WORK}/prefix/bin/isoskin check ${WORK}/skin.ply)
file(REMOVE_RECURSE ${WORK})
