# cmake -DISOSKIN=<program> -DDATA=<tests/data> -DOUT=<folder> -P demo.cmake
# Tracks a real fluid sequence and a moving skeleton, renders three frames of each with the tracked texture, the middle one
# also with the mesh's edges, compares the middle mesh with its ray-traced field, and names what it wrote.
cmake_minimum_required(VERSION 3.25)

set(size 960x720)
set(compared_size 512x512)
set(fluid ${DATA}/dam_break/dam_break.%04d.vdb)
set(skeleton ${DATA}/two_points.toml)
set(fluid_range 27:50)
set(skeleton_range 20:60)  # they merge in 24 and part in 58
set(fluid_frames 27 38 50)
set(skeleton_frames 22 34 60)

function(say)
  execute_process(COMMAND ${CMAKE_COMMAND} -E echo ${ARGV})
endfunction()

function(isoskin)
  execute_process(COMMAND ${ISOSKIN} ${ARGV} RESULT_VARIABLE status)
  if(NOT status EQUAL 0)
    list(JOIN ARGV " " command)
    message(FATAL_ERROR "isoskin ${command}\nended with status ${status}")
  endif()
endfunction()

function(picture folder frame name size)
  isoskin(render ${folder} --frame ${frame} --size ${size} -o ${folder}/${name}.exr ${ARGN})
endfunction()

function(demonstrate name input range)
  set(folder ${OUT}/${name})
  say("== ${name}: tracking ${input}")
  isoskin(track ${input} -o ${folder} --frames ${range})
  say("== ${name}: rendering")
  foreach(frame ${ARGN})
    picture(${folder} ${frame} texture.${frame} ${size} --shading checker --antialias 2)
  endforeach()
  list(GET ARGN 1 middle)
  picture(${folder} ${middle} mesh.${middle} ${compared_size})
  picture(${folder} ${middle} wireframe.${middle} ${size} --mesh mechanical --wireframe --antialias 2)
  picture(${folder} ${middle} field.${middle} ${compared_size} --what field)
  say("== ${name}: the mesh of frame ${middle} against its ray-traced field")
  # Status 1 is an answer, printed as the verdict, not a failure.
  execute_process(COMMAND ${ISOSKIN} compare ${folder}/mesh.${middle}.exr ${folder}/field.${middle}.exr
    -o ${folder}/difference.${middle}.exr RESULT_VARIABLE status)
  if(status GREATER 1)
    message(FATAL_ERROR "isoskin compare ended with status ${status}")
  endif()
  isoskin(info ${folder})
endfunction()

file(REMOVE_RECURSE ${OUT})
demonstrate(fluid ${fluid} ${fluid_range} ${fluid_frames})
demonstrate(skeleton ${skeleton} ${skeleton_range} ${skeleton_frames})

say("== written to ${OUT}")
foreach(name fluid skeleton)
  foreach(kind "meshes *.ply" "pictures *.exr" "previews *.png" "reports *.jsonl")
    separate_arguments(kind)
    list(GET kind 0 what)
    list(GET kind 1 pattern)
    file(GLOB files ${OUT}/${name}/${pattern})
    list(LENGTH files count)
    list(GET files 0 first)
    list(GET files -1 last)
    say("${name}: ${count} ${what}, ${first} .. ${last}")
  endforeach()
endforeach()
